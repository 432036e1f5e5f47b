"""Looks of a world: named ranges in `catalogue.yaml`, and one look drawn from them by a seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.sensors.fisheye import Float64
from sitl_sim.sensors.looks.catalogue import catalogue
from sitl_sim.sensors.looks.tiles import VARIANTS, palette, tile

_BARKS_PER_WORLD = 3


@dataclass(frozen=True)
class Material:
    """A texture tile and its colours: mip pyramid (n,), palette (HUES × 256,) packed BGR."""

    kind: str
    texels: NDArray[np.uint16]
    colours: NDArray[np.uint32]


@dataclass(frozen=True)
class Light:
    """Light of the scene. sun: (3,) unit, towards it. BGR gains: of the sun, of sky and shade."""

    sun: Float64
    direct: Float64
    ambient: Float64
    dapple: float


@dataclass(frozen=True)
class Sky:
    """kind: clear, cloudy, overcast, dusk. horizon: what stands there. BGR: zenith, haze."""

    kind: str
    horizon: str
    zenith: Float64
    haze: Float64


@dataclass(frozen=True)
class CameraLook:
    """What sensor, lens and image processor do to a picture.

    gains: (3,) BGR, the white balance. exposure: stops beside the automatic one. noise: grey
    levels. blur: px. shutter: s. quality: of JPEG, above 95 none. dirt, glare: 0: none.
    """

    gains: Float64
    exposure: float
    gamma: float
    saturation: float
    noise: float
    blur: float
    vignette: float
    shutter: float
    quality: int
    dirt: float
    glare: float


@dataclass(frozen=True)
class WorldLook:
    """One look, completely drawn. patch: share of the second ground. fog: m, range of 1/e."""

    name: str
    ground: Material
    second: Material
    patch: float
    barks: tuple[Material, ...]
    leaves: Material
    wall: Material
    canopy: float
    fog: float
    sky: Sky
    light: Light
    camera: CameraLook


def draw(name: str, seed: int) -> WorldLook:
    """Draw a look by its name, other than plain; the same seed gives the same look.

    Raises:
        SettingsError: there is no such look.
    """
    known = catalogue()["looks"] | catalogue()["unreadable"]
    if name not in known:
        raise SettingsError([f"no look {name!r} to draw; valid: {', '.join(known)}"])
    rng = np.random.default_rng([seed, 0x100C, sorted(known).index(name)])
    return _Draw(name, catalogue()["defaults"] | known[name], rng).look()


class _Draw:
    """Draws the parts of one look, in a fixed order."""

    def __init__(self, name: str, ranges: dict[str, Any], rng: np.random.Generator) -> None:
        self._name, self._ranges, self._rng = name, ranges, rng
        self._jitter = self._value("jitter")
        self._contrast = self._value("contrast")

    def look(self) -> WorldLook:
        ground, second = self._choice("grounds"), self._choice("patches")
        barks = [self._choice("barks") for _ in range(_BARKS_PER_WORLD)]
        sky = self._sky()
        return WorldLook(
            name=self._name,
            ground=self._material("ground", ground),
            second=self._material("ground", second),
            patch=max(self._value("patch"), 0.0),
            barks=tuple(self._material("bark", kind) for kind in barks),
            leaves=self._material("leaves", "leaves"),
            wall=self._material("wall", self._choice("walls")),
            canopy=max(self._value("canopy"), 0.0),
            fog=self._value("fog_m", log=True),
            sky=sky,
            light=self._light(sky.kind),
            camera=self._camera(),
        )

    def _value(self, key: str, log: bool = False) -> float:
        low, high = self._ranges[key]
        if log:
            return float(np.exp(self._rng.uniform(np.log(low), np.log(high))))
        return float(self._rng.uniform(low, high))

    def _choice(self, key: str) -> str:
        return str(self._rng.choice(self._ranges[key]))

    def _material(self, family: str, kind: str) -> Material:
        colours = catalogue()["colours"][family]
        choices = colours[0] if family == "leaves" else colours[kind]
        stops = np.array(choices[self._rng.integers(len(choices))], float)[:, ::-1]
        contrast = self._contrast * self._rng.uniform(0.8, 1.2)
        texels = tile(family, kind, int(self._rng.integers(VARIANTS)))
        return Material(kind, texels, palette(self._varied(stops), contrast))

    def _varied(self, stops: Float64) -> Float64:
        """Return colours (k,3) moved by the look's jitter: brightness, and each channel."""
        j, rng = self._jitter, self._rng
        moved = stops * np.exp(rng.normal(0, 0.35 * j)) * np.exp(rng.normal(0, 0.30 * j, 3))
        if j > 0.3 and rng.random() < j - 0.3:  # another hue altogether
            moved = moved.mean(axis=1, keepdims=True) * rng.uniform(0.5, 1.5, 3)
        varied: Float64 = np.clip(moved, 6, 240)
        return varied

    def _sky(self) -> Sky:
        kind, horizon = self._choice("skies"), self._choice("horizons")
        rng = self._rng
        zenith = {
            "clear": np.array([205.0, 140, 82]),
            "cloudy": np.array([206.0, 156, 108]),
            "overcast": np.array([196.0, 190, 184]),
            "dusk": np.array([120.0, 84, 72]),
        }[kind]
        haze = {
            "clear": np.array([226.0, 214, 198]),
            "cloudy": np.array([222.0, 216, 206]),
            "overcast": np.array([206.0, 204, 200]),
            "dusk": np.array([120.0, 164, 222]),
        }[kind]
        spread = 0.08 + 0.2 * self._jitter
        zenith = np.clip(zenith * np.exp(rng.normal(0, spread, 3)), 20, 250)
        haze = np.clip(haze * np.exp(rng.normal(0, spread, 3)), 30, 250)
        if self._name in ("fog", "blank"):
            zenith = haze = np.full(3, float(rng.uniform(110, 210)))
        return Sky(kind, horizon, zenith, haze)

    def _light(self, sky: str) -> Light:
        rng = self._rng
        height, towards = np.radians(self._value("sun_deg")), rng.uniform(-np.pi, np.pi)
        flat = np.cos(height)
        sun = np.array([flat * np.cos(towards), flat * np.sin(towards), np.sin(height)])
        direct, ambient = {
            "clear": (np.array([0.78, 0.92, 1.0]), np.array([0.50, 0.42, 0.38])),
            "cloudy": (np.array([0.52, 0.56, 0.58]), np.array([0.56, 0.54, 0.53])),
            "overcast": (np.zeros(3), np.array([0.92, 0.90, 0.88])),
            "dusk": (np.array([0.28, 0.52, 0.86]), np.array([0.46, 0.38, 0.36])),
        }[sky]
        low = np.clip(1 - np.degrees(height) / 20, 0, 1)  # a low sun is red and weak
        direct = direct * (1 - low * np.array([0.5, 0.3, 0.1])) * rng.uniform(0.7, 1.2)
        return Light(sun, direct, ambient * rng.uniform(0.8, 1.15), max(self._value("dapple"), 0.0))

    def _camera(self) -> CameraLook:
        warmth, tint = self._value("warmth"), self._value("tint")
        return CameraLook(
            gains=np.exp([-warmth, tint, warmth]),
            exposure=self._value("exposure"),
            gamma=self._value("gamma"),
            saturation=self._value("saturation"),
            noise=self._value("noise"),
            blur=max(self._value("blur"), 0.0),
            vignette=self._value("vignette"),
            shutter=self._value("shutter_ms") / 1e3,
            quality=round(self._value("quality")),
            dirt=max(self._value("dirt"), 0.0),
            glare=self._value("glare"),
        )
