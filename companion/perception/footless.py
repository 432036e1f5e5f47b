"""How far an obstacle is whose foot does not show, by its width and the obstacles beside it.

Its foot lies below the picture, or a low object hides it: so its distance is bounded. Of the
distance t to its surface and its radius r only sin β = r / (r + t) is seen, β half the angular
width; where the picture's side cuts it, β is at least half of what shows. Obstacles stand
anywhere, so that as many are at t as there is area, and thin ones are as common as thick ones (each
octave of radius the same), but trunks of one stand are of like girth: most have a radius near one
of those measured in the same picture. The distance given is that of the least mean relative error.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector

NEAREST = 0.2  # m: nothing is nearer to a camera than its own drone reaches
WIDEST = 1.3  # rad; half of an obstacle's width
_STEPS = np.linspace(0.0, 1.0, 48)
_WIDTHS = np.linspace(0.0, 1.0, 24)
_CUT = 3.0  # times its visible width that an obstacle cut by the picture's side may have
_GIRTH = 0.4  # 1 σ of the log of the ratio of two radii of one stand
_OTHER = 0.1  # share, at the most likely radius, of obstacles that are of another kind


def within(
    bounds: tuple[float, float],
    half: float,
    cut: bool,
    limits: tuple[float, float],
    radii: Vector,
) -> tuple[float, float, float]:
    """Return the distance [m] of the surface of an obstacle, its 1 σ, and β [rad].

    bounds: m, between which the surface is. half: rad, half the width that shows. cut: the
    picture's side hides the rest. limits: m, least and largest radius of obstacles. radii (n,): m,
    of the obstacles measured in the same picture.
    """
    half = min(half, WIDEST)
    beta = np.array([half])
    if cut:
        beta = half + _WIDTHS * (min(_CUT * half, WIDEST) - half)
    sine = np.sin(beta)[:, None]
    low, high = max(bounds[0], NEAREST), max(bounds[1], 1.1 * NEAREST)
    tried = min(low, 0.9 * high) * (high / min(low, 0.9 * high)) ** _STEPS
    radius = tried * sine / (1.0 - sine)
    share = ((radius >= limits[0]) & (radius <= limits[1])) + 1e-9
    if len(radii):
        apart = np.log(radius[..., None] / radii) / _GIRTH
        share *= np.exp(-0.5 * apart * apart).mean(axis=-1) + _OTHER
    # Radii are even in their log: so many of them there are for each β.
    share *= np.cos(beta)[:, None] / (sine * (1.0 - sine) ** 2)
    # Steps are of equal ratio: as many obstacles are in each as its t². Relative errors weigh 1/t.
    surface = _median(tried, share.sum(axis=0) * tried)
    square = np.average((tried - surface) ** 2, weights=share.sum(axis=0) * tried * tried)
    wide = _median(beta, (share * tried).sum(axis=1)) if cut else half
    return surface, float(np.sqrt(square)), wide


def _median(values: Vector, weights: Vector) -> float:
    """Return the value (n,) above and below which there is equal weight."""
    sums = np.cumsum(weights) - 0.5 * weights
    return float(np.interp(0.5 * (sums[-1] + 0.5 * weights[-1]), sums, values))
