"""What a commissioning flight tells, how surely, and what it cannot tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.commissioning.camera_fit import CameraFit, fit_camera
from companion.commissioning.flight import CommissioningFlight
from companion.commissioning.thrust_fit import ThrustFit, fit_thrust
from companion.settings.edit import Value
from mavlink_bridge.shared.arrays import Vector

_EXPLAINED = 0.6  # share of the corners that must move as the gyro says
_STILL = 0.2  # rad/s, rms; a slower turn about an axis tells little
_FOCAL = (0.7, 1.4)  # factors that a lens can be off by
_LAG = 0.24  # s, either way: the search goes no farther


@dataclass(frozen=True)
class _Kind:
    """What is found under a name.

    unit: of value and 1 σ. floor: least 1 σ that is claimed. sure: most 1 σ with which the value
    is told. apart: most by which the halves of the flight may differ.
    """

    unit: str
    floor: float
    sure: float
    apart: float


_KINDS = {
    "mount roll": _Kind("°", 0.15, 1.0, 4.0),
    "mount pitch": _Kind("°", 0.15, 1.0, 4.0),
    "mount yaw": _Kind("°", 0.15, 1.0, 4.0),
    "picture lag": _Kind("s", 0.001, 0.005, 0.02),
    "focal scale": _Kind("", 0.002, 0.005, 0.02),
    "hover thrust": _Kind("", 0.003, 0.008, 0.02),
    "drag": _Kind("1/s", 0.01, 0.08, 0.4),
    "command delay": _Kind("s", 0.003, 0.007, 0.02),
}
_CAMERA = list(_KINDS)[:5]


@dataclass(frozen=True)
class Finding:
    """A value and its 1 σ, in `unit`; refusal: why it cannot be told, empty where it is."""

    name: str
    value: float
    sigma: float
    unit: str
    refusal: str = ""

    @property
    def told(self) -> bool:
        """Whether the flight tells it."""
        return not self.refusal


def find(flight: CommissioningFlight) -> list[Finding]:
    """Return all findings of a flight, told or refused."""
    c, velocity = flight.config, (flight.states[:, 0], flight.states[:, 4:7])
    start = [*c.camera.mount_deg, c.camera.lag, 1.0]
    camera = fit_camera(flight.camera, start, flight.curve, velocity, flight.pairs)
    thrust = fit_thrust(flight.ticks, flight.curve, velocity, c.airframe.thrust_exponent)
    return [*_of_camera(camera, turning(flight)), *_of_thrust(thrust), _of_delay(flight)]


def changes(flight: CommissioningFlight, findings: list[Finding]) -> dict[tuple[str, str], Value]:
    """Return what the configuration is to say, by (section, key); what was refused stays.

    Without a calibration file the focal length is `camera.fov_deg`; with one, it is the file's.
    """
    told = {f.name: f.value for f in findings if f.told}
    c = flight.config
    made: dict[tuple[str, str], Value] = {}
    mount = [told.get(n, old) for n, old in zip(_CAMERA[:3], c.camera.mount_deg, strict=True)]
    if any(n in told for n in _CAMERA[:3]):
        made["camera", "mount_deg"] = [round(a, 2) for a in mount]
    if "picture lag" in told:
        made["camera", "lag"] = round(told["picture lag"], 4)
    if "focal scale" in told and c.camera.calibration is None:
        made["camera", "fov_deg"] = round(c.camera.fov_deg / told["focal scale"], 2)
    if "hover thrust" in told:
        made["airframe", "hover_thrust"] = round(told["hover thrust"], 4)
    if "drag" in told:
        made["airframe", "drag"] = round(max(told["drag"], 0.0), 3)
    if "command delay" in told:
        made["timing", "delay"] = round(told["command delay"], 4)
    return made


def turning(flight: CommissioningFlight) -> Vector:
    """Return the rms (3,) rad/s of the body rates about forward, left and up in flight."""
    omega = np.array([t["own"]["omega"] for t in flight.ticks])
    rms: Vector = np.sqrt((omega**2).mean(axis=0))
    return rms


def _of_camera(fit: CameraFit | None, turned: Vector) -> list[Finding]:
    if fit is None:
        why = "too few pictures could be compared: is there anything to see?"
        return [_refused(name, why) for name in _CAMERA]
    if fit.explained < _EXPLAINED:
        why = (
            f"only {fit.explained:.0%} of what was followed moves as the gyro says: a mirrored or "
            "loose camera, another lens, or other things that move"
        )
        return [_refused(name, why) for name in _CAMERA]
    why = ""
    if abs(fit.values[3]) > _LAG:
        why = f"the pictures' lag is beyond {_LAG:g} s, where nothing was tried"
    elif not _FOCAL[0] < fit.values[4] < _FOCAL[1]:
        why = f"the focal length would be {fit.values[4]:.2f} times the configured one"
    sigmas = np.sqrt(np.diag(fit.covariance))
    slow = [n for n, w in zip(("roll", "pitch", "yaw"), turned, strict=True) if w < _STILL]
    rates = ", ".join(f"{w:.2f}" for w in turned)
    more = f": it turned with {rates} rad/s (rms) about roll, pitch, yaw"
    if slow:
        more += f", too little about {' and '.join(slow)}"
    return [
        _judged(n, float(v), float(s), halves, why, more)
        for n, v, s, halves in zip(_CAMERA, fit.values, sigmas, fit.halves.T, strict=True)
    ]


def _of_thrust(fit: ThrustFit | None) -> list[Finding]:
    names = ("hover thrust", "drag")
    if fit is None:
        return [_refused(name, "the companion flew for too short a time") for name in names]
    hover = fit.sigmas * np.array([fit.values[0], 1.0])
    return [
        _judged(n, float(v), float(s), halves, "", more)
        for n, v, s, halves, more in zip(
            names,
            fit.values,
            hover,
            fit.halves.T,
            (": thrust or height hardly changed", ": it was too slow"),
            strict=True,
        )
    ]


def _of_delay(flight: CommissioningFlight) -> Finding:
    """Return the delay from a tick to its effect, as the flight ended up with."""
    value, sigma = flight.ticks[-1]["delay"]
    middle = flight.ticks[len(flight.ticks) // 2]["delay"][0]
    halves = np.array([middle, value])
    more = ": the gyro did not follow clearly"
    return _judged("command delay", value, sigma, halves, "", more, steady=False)


def _judged(
    name: str,
    value: float,
    sigma: float,
    halves: Vector,
    why: str,
    more: str,
    steady: bool = True,
) -> Finding:
    """Return the finding, refused where it is too uncertain or the halves disagree.

    steady: whether the halves' difference adds to the doubt.
    """
    kind = _KINDS[name]
    off = abs(float(halves[1] - halves[0]))
    own = math.hypot(sigma, kind.floor)
    sigma = math.hypot(own, off / 2.0) if steady else own
    both = " and ".join(f"{h:.3g}" for h in halves) + f" {kind.unit}".rstrip()
    if not own <= kind.sure:  # first: what is not determined may be anything
        why = f"known to ±{own:.2g} {kind.unit}".rstrip() + f" only{more}"
    elif not why and (off > kind.apart or not sigma <= kind.sure):
        why = f"the halves of the flight disagree: {both}"
    return Finding(name, value, sigma, kind.unit, why)


def _refused(name: str, why: str) -> Finding:
    return Finding(name, math.nan, math.inf, _KINDS[name].unit, why)
