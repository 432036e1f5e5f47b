"""From scene light to the bytes of a real camera.

Motion blur, glare, dirt, white balance, exposure, tone curve, noise, compression.
"""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float32, Float64, Lens
from sitl_sim.sensors.looks.look import CameraLook
from sitl_sim.sensors.sensor import NOISE_BANK

UInt8 = NDArray[np.uint8]
_MASK = NOISE_BANK - 1
_MIDDLE = 112.0  # grey level that the automatic exposure aims at
_SIDE, _MID = np.float32(0.14), np.float32(0.72)
_ZERO, _MAX, _HALF, _ONE = np.float32(0), np.float32(255), np.float32(0.5), np.float32(1)
_FAST = {"contract", "nsz"}
_BLUR_PIXELS = 0.7  # less motion than this during the exposure does not show


def lens_map(rng: np.random.Generator, lens: Lens, look: CameraLook) -> Float32:
    """Return (2,h,w): gain by vignette and dirt, and grey levels that dirt adds."""
    y, x = np.mgrid[0 : lens.height, 0 : lens.width].astype(np.float32)
    middle = ((lens.width - 1) / 2, (lens.height - 1) / 2)
    off = rng.normal(0, 0.02, 2) * lens.width
    r2 = (x - middle[0] - off[0]) ** 2 + (y - middle[1] - off[1]) ** 2
    gain = 1 - look.vignette * r2 / (middle[0] ** 2 + middle[1] ** 2)
    veil = np.zeros_like(gain)
    for _ in range(int(rng.poisson(14 * look.dirt))):
        spot = np.zeros_like(gain)
        radius = float(np.exp(rng.uniform(np.log(3), np.log(38))))
        at = (int(rng.uniform(0, lens.width)), int(rng.uniform(0, lens.height)))
        axes = (int(radius) + 1, int(radius * rng.uniform(0.4, 1)) + 1)
        cv2.ellipse(spot, at, axes, float(rng.uniform(0, 180)), 0, 360, 1.0, -1)
        spot = cv2.GaussianBlur(spot, (0, 0), 0.35 * radius + 1)
        gain *= 1 - rng.uniform(0.02, 0.4) * spot
        veil += rng.uniform(0, 35) * spot
    return np.stack([np.clip(gain, 0.05, 1.2), veil]).astype(np.float32)


def motion_blur(raw: UInt8, lens: Lens, omega_c: Float64, shutter: float) -> UInt8:
    """Return the picture smeared by turning at omega_c (3,) rad/s, camera frame.

    Samples of the exposure are warped by the mean motion (a shift and a turn of the image).
    """
    turn = omega_c * shutter
    shift = lens.f * np.array([-turn[1], turn[0]])
    roll = -turn[2]
    reach = math.hypot(*shift) + abs(roll) * lens.width / 3
    if reach < _BLUR_PIXELS:
        return raw
    samples = int(np.clip(np.ceil(reach / 1.5) + 1, 2, 8))
    total = np.zeros(raw.shape, np.uint16)
    middle = ((lens.width - 1) / 2, (lens.height - 1) / 2)
    for s in np.linspace(-0.5, 0.5, samples):
        warp = cv2.getRotationMatrix2D(middle, float(np.degrees(-roll * s)), 1.0)
        warp[:, 2] += s * shift
        size = (lens.width, lens.height)
        moved = cv2.warpAffine(raw, warp, size, borderMode=cv2.BORDER_REPLICATE)
        total += moved.astype(np.uint16)
    return (total // samples).astype(np.uint8)


def glare_of(lens: Lens, small: Lens, sun_c: Float64, strength: float) -> Float32:
    """Return the grey levels (h,w) that the sun's light in the lens adds; sun_c: unit, camera.

    small: the lens at the size, an eighth, at which the light is reckoned.
    """
    away = np.arccos(np.clip(np.tensordot(sun_c.astype(np.float32), small.rays, 1), -1, 1))
    seen = np.clip((2.0 - math.acos(float(np.clip(sun_c[2], -1, 1)))) / 0.6, 0, 1)
    veil = strength * seen * (160 * np.exp(-away / 0.12) + 70 * np.exp(-away / 0.5) + 18)
    made: Float32 = cv2.resize(
        veil.astype(np.float32), (lens.width, lens.height), interpolation=cv2.INTER_LINEAR
    )
    return made


def tone(gamma: float) -> UInt8:
    """Return the tone curve (1024,) of light 0…2 (1: full scale), with a soft shoulder."""
    light = np.linspace(0, 2, 1024)
    knee = np.where(light < 0.8, light, 0.8 + 0.2 * np.tanh((light - 0.8) / 0.2))
    return np.clip(255 * knee**gamma, 0, 255).astype(np.uint8)


def exposure_gain(raw: UInt8, look: CameraLook) -> float:
    """Return the gain of the automatic exposure, and its error; in twilight it does not suffice."""
    mean = float(raw[::8, ::8].mean()) + 1.0
    return float(np.clip(_MIDDLE / mean, 0.4, 2.2) * 2.0**look.exposure)


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def develop(raw, field, glare, gains, saturation, curve, noise, offset, sigma, out):  # type: ignore[no-untyped-def]
    """Apply lens blur, dirt and vignette, glare, gains, saturation, noise and tone: raw → out.

    raw, out: (h,w,3) uint8. field: of `lens_map`. glare: (h,w), or no rows. gains: (3,) BGR.
    curve: of `tone`. noise: (NOISE_BANK,) int8, offset: index of this frame's. sigma: grey levels.
    A row is developed in passes, so that what is between the look-ups becomes SIMD.
    """
    h, w = raw.shape[0], raw.shape[1]
    n = 3 * w
    flat, result = raw.reshape(h, n), out.reshape(h, n)
    soft = np.empty(n + 6, np.float32)
    sides = np.empty(n, np.float32)
    planes = np.empty((3, w), np.float32)
    index = np.empty(n, np.int32)
    blue, green, red = planes[0], planes[1], planes[2]
    add = np.zeros(w, np.float32)
    gain_b, gain_g, gain_r = np.float32(gains[0]), np.float32(gains[1]), np.float32(gains[2])
    keep, strength = np.float32(saturation), np.float32(sigma)
    top = np.float32(curve.shape[0] - 1)
    scale = np.float32(curve.shape[0] / 2.0 / 255.0)
    state = offset
    flares = glare.shape[0] > 0
    for y in range(h):
        up, down, here = flat[max(y - 1, 0)], flat[min(y + 1, h - 1)], flat[y]
        for i in range(n):
            soft[i + 3] = _SIDE * (np.float32(up[i]) + np.float32(down[i])) + _MID * np.float32(
                here[i]
            )
        for c in range(3):
            soft[c], soft[n + 3 + c] = soft[3 + c], soft[n + c]
        for i in range(n):
            sides[i] = _SIDE * (soft[i] + soft[i + 6]) + _MID * soft[i + 3]
        state = (state * 1664525 + 1013904223) & 0xFFFFFFFF
        first = min((state >> 8) & _MASK, NOISE_BANK - n)
        grain = noise[first : first + n]
        bright, veil = field[0, y], field[1, y]
        if flares:
            for x in range(w):
                add[x] = veil[x] + glare[y, x]
        else:
            for x in range(w):
                add[x] = veil[x]
        for x in range(w):
            blue[x] = sides[3 * x]
            green[x] = sides[3 * x + 1]
            red[x] = sides[3 * x + 2]
        for x in range(w):
            b = (blue[x] * bright[x] + add[x]) * gain_b
            g = (green[x] * bright[x] + add[x]) * gain_g
            r = (red[x] * bright[x] + add[x]) * gain_r
            grey = np.float32(0.114) * b + np.float32(0.587) * g + np.float32(0.299) * r
            blue[x] = grey + keep * (b - grey)
            green[x] = grey + keep * (g - grey)
            red[x] = grey + keep * (r - grey)
        for x in range(w):
            sides[3 * x] = blue[x]
            sides[3 * x + 1] = green[x]
            sides[3 * x + 2] = red[x]
        for i in range(n):
            light = sides[i]
            # Shot noise grows with the root of the light, here approximated by a line.
            light += (
                np.float32(grain[i]) * strength * (np.float32(0.6) + light * np.float32(0.0032))
            )
            index[i] = np.int32(min(max(light * scale, _ZERO), top))
        row = result[y]
        for i in range(n):
            row[i] = curve[np.uintp(index[i])]


def compressed(picture: UInt8, quality: int) -> UInt8:
    """Return the picture after JPEG at this quality."""
    _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    return cv2.imdecode(coded, cv2.IMREAD_COLOR)  # type: ignore[return-value]
