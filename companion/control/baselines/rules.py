"""Velocity rules from the literature, each as in its paper.

All are horizontal; the tracking law holds the height. Where a paper has no obstacles, they count as
virtual agents at their nearest surface point (Olfati-Saber, "Flocking for multi-agent dynamic
systems", IEEE TAC 51(3), 2006).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from companion.control.baselines.config import (
    PotentialFieldConfig,
    ReynoldsConfig,
    VasarhelyiConfig,
)
from companion.control.baselines.surroundings import Surroundings
from companion.control.nmpc import Instance
from mavlink_bridge.shared.arrays import Vector, norm

_NEAREST = 0.05  # m: repulsion grows no further


class Rule(Protocol):
    """A velocity rule."""

    def velocity(self, around: Surroundings) -> Vector:
        """Return the velocity (2,) m/s to fly next, not yet bounded."""
        ...


class InputRule(Protocol):
    """Gives an input itself."""

    def command(self, around: Surroundings, instance: Instance) -> Vector:
        """Return the input (4,) to fly next: c [m/s²], ω [rad/s], body axes; it is clipped."""
        ...


class Reynolds:
    """Schilling, Schiano, Floreano, "Vision-based drone flocking in outdoor environments", 2021.

    IEEE RA-L 6(2), eq. (5)–(8): v = v_sep + v_coh + v_mig, means over the neighbours in view;
    after Reynolds, "Flocks, herds and schools", SIGGRAPH 1987.
    """

    def __init__(self, config: ReynoldsConfig, flocking: bool) -> None:
        self._config = config
        self._flocking = flocking

    def velocity(self, around: Surroundings) -> Vector:
        """Return the sum of migration, separation and cohesion, (2,) m/s."""
        c = self._config
        v = around.migration + self._apart(around.neighbours, c.separation)
        near = around.surfaces[np.linalg.norm(around.surfaces, axis=1) < c.obstacle_range]
        v = v + self._apart(near, c.obstacle)
        if self._flocking and len(around.neighbours):
            weighted = around.neighbours * around.cohesion[:, None]
            v = v + c.cohesion * weighted.mean(axis=0)
        return np.asarray(v, float)

    @staticmethod
    def _apart(offsets: Vector, gain: float) -> Vector:
        """Return -gain · mean of r / |r|² over offsets r (k,2), eq. (5)."""
        if not len(offsets):
            return np.zeros(2)
        square = np.maximum((offsets**2).sum(axis=1), _NEAREST**2)
        apart: Vector = -gain * (offsets / square[:, None]).mean(axis=0)
        return apart


class Vasarhelyi:
    """Vásárhelyi et al., "Optimized flocking of autonomous drones in confined environments", 2018.

    Science Robotics 3(20), eq. (1)–(9): repulsion, friction, and shill agents on obstacles that
    fly away from them; the flock's own speed goes towards the target.
    """

    def __init__(self, config: VasarhelyiConfig) -> None:
        self._config = config

    def velocity(self, around: Surroundings) -> Vector:
        """Return the sum of self-propulsion and all interactions, (2,) m/s."""
        v = around.migration + self._repulsion(around) + self._friction(around)
        return np.asarray(v + self._shills(around), float)

    def _repulsion(self, around: Surroundings) -> Vector:
        """Return the sum of p_rep (r0 - r) away from all neighbours nearer than r0, (2,) m/s."""
        c, out = self._config, np.zeros(2)
        for offset in around.neighbours:
            r = max(norm(offset), _NEAREST)
            out -= c.p_rep * max(c.r0_rep - r, 0.0) * offset / r
        return out

    def _friction(self, around: Surroundings) -> Vector:
        """Return the alignment of velocities that differ by more than the braking curve allows."""
        c, out = self._config, np.zeros(2)
        for offset, velocity in zip(around.neighbours, around.velocities, strict=True):
            allowed = braking_curve(norm(offset) - c.r0_frict, c.a_frict, c.p_frict)
            out += c.c_frict * _excess(velocity - around.v, max(c.v_frict, allowed))
        return out

    def _shills(self, around: Surroundings) -> Vector:
        """Return the friction, at full strength, with agents that fly away from the obstacles."""
        c, out = self._config, np.zeros(2)
        for offset in around.surfaces:
            r = max(norm(offset), _NEAREST)
            allowed = braking_curve(r - c.r0_shill, c.a_shill, c.p_shill)
            out += _excess(-c.v_shill * offset / r - around.v, allowed)
        return out


def braking_curve(r: float, a: float, p: float) -> float:
    """Return D(r, a, p): the speed [m/s] that a drone stops from within r [m].

    a: m/s². p: 1/s, linear gain at the end.
    """
    if r <= 0.0:
        return 0.0
    return r * p if r * p < a / p else float(np.sqrt(2.0 * a * r - a * a / (p * p)))


def _excess(difference: Vector, allowed: float) -> Vector:
    """Return `difference` (2,) shortened by `allowed`; 0 where it is shorter."""
    size = norm(difference)
    if size <= allowed:
        return np.zeros(2)
    return np.asarray(difference * (1.0 - allowed / size), float)


class PotentialField:
    """Khatib, "Real-time obstacle avoidance for manipulators and mobile robots", IJRR 5(1), 1986.

    Eq. (11)–(15): attraction of limited speed, and η (1/ρ - 1/ρ0)/ρ² away from each surface
    nearer than ρ0; the force is flown as a velocity.
    """

    def __init__(self, config: PotentialFieldConfig, radius: float) -> None:
        self._config = config
        self._radius = radius

    def velocity(self, around: Surroundings) -> Vector:
        """Return the sum of attraction and repulsions, (2,) m/s."""
        c = self._config
        agents = _repulsion_of(around.neighbours, 2 * self._radius, c.eta_agent, c.rho_agent)
        obstacles = _repulsion_of(around.surfaces, self._radius, c.eta_obstacle, c.rho_obstacle)
        return np.asarray(around.migration + agents + obstacles, float)


def _repulsion_of(offsets: Vector, size: float, eta: float, reach: float) -> Vector:
    """Return the sum of the repulsions of offsets (k,2) m at ρ = distance - size, (2,) m/s."""
    out = np.zeros(2)
    for offset in offsets:
        distance = max(norm(offset), _NEAREST)
        rho = max(distance - size, _NEAREST)
        if rho < reach:
            out -= eta * (1.0 / rho - 1.0 / reach) / rho**2 * offset / distance
    return out
