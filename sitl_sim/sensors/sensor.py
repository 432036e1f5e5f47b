"""From scene light to a sensor's bytes: lens blur, vignette, exposure, noise; depth images."""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.sensors.scene import scene_range

NOISE_BANK = 1 << 20  # precomputed normal samples, σ = 32
_MASK = NOISE_BANK - 1
# A lens spreads a point over its neighbours: 3×3 kernel, σ ≈ 0.55 px.
_SIDE, _MID = np.float32(0.14), np.float32(0.72)
_ZERO, _MAX, _HALF = np.float32(0), np.float32(255), np.float32(0.5)


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def develop(raw, noise, offset, sigma, exposure, vignette, out):  # type: ignore[no-untyped-def]
    """Apply lens blur (3×3), vignette, exposure and noise: raw → out, both (h,w,3) uint8.

    noise: (NOISE_BANK,) int8. offset: index of this frame's noise. sigma: grey levels per unit.
    """
    h, w = raw.shape[0], raw.shape[1]
    n = 3 * w
    flat = raw.reshape(h, n)
    result = out.reshape(h, n)
    rows = np.empty(n + 6, np.float32)
    fade = np.empty(n, np.float32)
    scale = np.float32(vignette) / np.float32((w * w + h * h) / 4)
    gain = np.float32(exposure)
    middle = np.float32((w - 1) / 2)
    for i in range(n):
        x = np.float32(i // 3) - middle
        fade[i] = x * x * scale
    state = offset
    strength = np.float32(sigma)
    for y in range(h):
        up, down = flat[max(y - 1, 0)], flat[min(y + 1, h - 1)]
        here = flat[y]
        for i in range(n):
            rows[i + 3] = _SIDE * (np.float32(up[i]) + np.float32(down[i])) + _MID * np.float32(
                here[i]
            )
        for c in range(3):
            rows[c], rows[n + 3 + c] = rows[3 + c], rows[n + c]
        dy = np.float32(y - (h - 1) / 2)
        bright = np.float32(1) - dy * dy * scale
        # Rows start at unrelated indices of the bank: no pattern repeats down the picture.
        state = (state * 1664525 + 1013904223) & 0xFFFFFFFF
        first = min((state >> 8) & _MASK, NOISE_BANK - n)
        grain = noise[first : first + n]
        line = result[y]
        for i in range(n):
            light = _SIDE * (rows[i] + rows[i + 6]) + _MID * rows[i + 3]
            light *= gain * (bright - fade[i])
            # Shot noise grows with the root of the light, here approximated by a line.
            spread = strength * (np.float32(0.6) + light * np.float32(0.0032))
            light += np.float32(grain[i]) * spread + _HALF
            line[i] = np.uint8(np.int32(min(max(light, _ZERO), _MAX)))


@njit(nogil=True, cache=True, error_model="numpy")
def depth_image(rays, rot, p, hill, table, count, boxes, start, which, out):  # type: ignore[no-untyped-def]
    """Write the distance to the static scene along each ray (3,h,w), camera frame, to out (h,w).

    hill: (3,) of `paint`.
    """
    for y in range(rays.shape[1]):
        for x in range(rays.shape[2]):
            a, b, c = rays[0, y, x], rays[1, y, x], rays[2, y, x]
            dx = rot[0, 0] * a + rot[0, 1] * b + rot[0, 2] * c
            dy = rot[1, 0] * a + rot[1, 1] * b + rot[1, 2] * c
            dz = rot[2, 0] * a + rot[2, 1] * b + rot[2, 2] * c
            out[y, x] = scene_range(
                p[0], p[1], p[2], dx, dy, dz, hill, table, count, boxes, start, which
            )


def measured(
    depth: NDArray[np.float32], range_max: float, noise: float, seed: int
) -> NDArray[np.float32]:
    """Return true distances (h,w) [m] as a depth sensor measures them; inf beyond `range_max`.

    noise: 1 σ as a share of the distance.
    """
    rng = np.random.default_rng([seed & 0xFFFFFFFF, 0xDE])
    noisy = depth * (1 + noise * rng.standard_normal(depth.shape, np.float32))
    return np.where(noisy <= range_max, noisy, np.float32(np.inf))
