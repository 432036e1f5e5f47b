"""Drones drawn from random parts: bodies, arms, propellers that stand still or are blurred, legs.

They are no airframe that exists. The network sees so many outlines that it has to learn what they
share: some arms with propellers around a compact body.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_FINE = 4  # drawn so many times as large, then made smaller
_EDGE = 1.15  # half the width of the drawing, in radii of the drone


def drawn_drone(
    rng: np.random.Generator, size: float
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return picture (n,n,3) BGR and opacity (n,n) 0…1 of a random drone of radius `size` [px]."""
    half = int(np.ceil(size * _EDGE)) + 1
    fine = max(2, min(_FINE, int(160 / half)))
    n = 2 * half * fine
    picture, opacity = np.zeros((n, n, 3), np.uint8), np.zeros((n, n), np.uint8)
    scale = size * fine
    tilt = float(rng.uniform(0.0, 0.55)) if rng.random() < 0.75 else float(rng.uniform(0.3, 1.0))
    roll = float(rng.normal(0, 0.2))
    colour = _colour(rng)
    dark = tuple(c * float(rng.uniform(0.3, 1.1)) for c in colour)
    spin = float(rng.uniform(0, 2 * np.pi))
    arms = int(rng.choice([4, 4, 4, 4, 6, 8]))
    reach = float(rng.uniform(0.62, 0.75))
    disc = 1.0 - reach
    thick = float(rng.uniform(0.02, 0.08))
    high = float(rng.uniform(-0.03, 0.12))  # of the propellers over the body

    def at(x: float, y: float, z: float) -> tuple[int, int]:
        """Return the pixel of a place in the body, radii; y away from the viewer, z up."""
        u, v = x, -(z * np.sqrt(1 - tilt * tilt) + y * tilt)
        u, v = u * np.cos(roll) - v * np.sin(roll), u * np.sin(roll) + v * np.cos(roll)
        return int(n / 2 + u * scale), int(n / 2 + v * scale)

    def ellipse(
        centre: tuple[int, int], a: float, b: float, c: tuple[float, ...], alpha: float
    ) -> None:
        axes = max(int(a * scale), 1), max(int(b * scale), 1)
        reach = max(axes) + 2
        u, v = centre
        part = np.s_[max(v - reach, 0) : max(v + reach, 0), max(u - reach, 0) : max(u + reach, 0)]
        mask = np.zeros_like(opacity[part])
        if not mask.size:
            return
        corner = u - part[1].start, v - part[0].start
        cv2.ellipse(mask, corner, axes, np.degrees(roll), 0, 360, 255, -1)
        hit = mask > 0
        before, shown = opacity[part], picture[part]
        share = alpha * (1 - before[hit, None] / 255.0 * 0.7)
        shown[hit] = (1 - share) * shown[hit] + share * np.array(c)
        before[hit] = np.maximum(before[hit], int(255 * alpha))

    def line(a: tuple[int, int], b: tuple[int, int], w: float, c: tuple[float, ...]) -> None:
        cv2.line(picture, a, b, c, max(int(w * scale), 1))
        cv2.line(opacity, a, b, 255, max(int(w * scale), 1))

    body = (float(rng.uniform(0.12, 0.4)), float(rng.uniform(0.06, 0.2)))
    angles = spin + 2 * np.pi * (np.arange(arms) + rng.uniform(-0.08, 0.08, arms)) / arms
    tips = [(reach * np.cos(t), reach * np.sin(t)) for t in angles]
    blurred = rng.random() < 0.7
    see_through = float(rng.uniform(0.08, 0.5))
    prop = _grey(rng)
    guard = rng.random() < 0.2
    if rng.random() < 0.4:  # legs
        spread, low = rng.uniform(0.15, 0.5), -rng.uniform(0.15, 0.45)
        for s in (-1, 1):
            line(at(s * spread * 0.5, 0, 0), at(s * spread, 0, low), 0.03, dark)
            line(at(s * spread - 0.1, 0, low), at(s * spread + 0.1, 0, low), 0.03, dark)
    for x, y in tips:
        line(at(0, 0, 0), at(x, y, 0), thick, colour)
        line(at(x, y, -0.02), at(x, y, high + 0.02), 0.06, dark)
        if blurred:
            ellipse(at(x, y, high), disc, max(disc * tilt, 0.012), prop, see_through)
        else:
            turn = rng.uniform(0, np.pi)
            dx, dy = disc * np.cos(turn), disc * np.sin(turn)
            line(at(x - dx, y - dy, high), at(x + dx, y + dy, high), 0.03, prop)
        if guard:
            ring = max(int(disc * scale), 1), max(int(disc * max(tilt, 0.05) * scale), 1)
            for target, value in ((picture, dark), (opacity, (255.0,))):
                cv2.ellipse(target, at(x, y, high), ring, np.degrees(roll), 0, 360, value, fine)
    ellipse(at(0, 0, 0), body[0], max(body[1], body[0] * tilt), colour, 1.0)
    if rng.random() < 0.5:
        ellipse(at(0, 0, float(rng.uniform(0.03, 0.15))), body[0] * 0.6, body[1] * 0.6, dark, 1.0)
    if rng.random() < 0.4:  # camera
        ellipse(at(float(rng.uniform(-0.1, 0.1)), 0, -body[1] - 0.05), 0.07, 0.07, _grey(rng), 1.0)
    small = (2 * half, 2 * half)
    alpha = cv2.resize(opacity, small, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    weight = np.maximum(opacity, 1)[..., None].astype(np.float32)
    mixed = cv2.resize(picture * weight, small, interpolation=cv2.INTER_AREA)
    mixed /= cv2.resize(weight, small, interpolation=cv2.INTER_AREA)[..., None]
    light = 1.0 + float(rng.uniform(-0.35, 0.35)) * np.linspace(-1, 1, 2 * half)[:, None, None]
    return np.clip(mixed * light, 0, 255).astype(np.uint8), alpha


def _colour(rng: np.random.Generator) -> tuple[float, float, float]:
    grey = float(rng.uniform(10, 245))
    spread = float(rng.choice([4.0, 15.0, 70.0]))
    b, g, r = np.clip(grey + rng.normal(0, spread, 3), 5, 250).tolist()
    return b, g, r


def _grey(rng: np.random.Generator) -> tuple[float, float, float]:
    grey = float(rng.uniform(10, 220))
    return grey, grey, grey
