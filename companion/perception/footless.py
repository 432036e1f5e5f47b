"""How far an obstacle is whose foot lies below the picture, by its width and the obstacles beside it.

Its foot would show if it were farther than a bound. Of its distance t to the surface and its radius
r only sin β = r / (r + t) is seen, β half the angular width. Obstacles stand anywhere, so that as
many are at t as the area there, and thin ones are as common as thick ones (each octave of radius
the same), but trunks of one stand are of like girth: most have a radius near one of those measured
in the same picture. The distance given is that of the least mean relative error.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector

NEAREST = 0.2  # m: nothing is nearer to a camera than its own drone reaches
_STEPS = np.linspace(0.0, 1.0, 48)
_GIRTH = 0.4  # 1 σ of the log of the ratio of two radii of one stand
_OTHER = 0.1  # share, at the most likely radius, of obstacles that are of another kind


def within(
    bound: float, sine: float, limits: tuple[float, float], radii: Vector
) -> tuple[float, float]:
    """Return the distance [m] and 1 σ of the surface of an obstacle nearer than `bound` [m].

    sine: of half its angular width. limits: least and largest radius [m] of obstacles. radii (n,):
    m, of the obstacles measured in the same picture.
    """
    free = 1.0 / min(max(sine, 1e-3), 0.99) - 1.0  # distance over radius
    high = max(min(bound, limits[1] * free), 1.1 * NEAREST)
    low = min(max(NEAREST, limits[0] * free), 0.9 * high)
    tried = low * (high / low) ** _STEPS
    share = np.ones(len(tried))
    if len(radii):
        apart = np.log((tried / free)[:, None] / radii) / _GIRTH
        share = np.exp(-0.5 * apart * apart).mean(axis=1) + _OTHER
    # Steps are of equal ratio: as many obstacles are in each as its t². Relative errors weigh 1/t.
    sums = np.cumsum(share * tried)
    surface = float(np.interp(0.5 * sums[-1], sums, tried))
    square = np.average((tried - surface) ** 2, weights=share * tried * tried)
    return surface, float(np.sqrt(square))
