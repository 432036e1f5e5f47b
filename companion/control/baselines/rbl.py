"""RBL, the rule-based Lloyd algorithm.

Source: Boldrer et al., "Rule-Based Lloyd Algorithm for Multi-Robot Motion Planning and Control with
Safety and Convergence Guarantees", 2023 (arXiv 2310.19511). A drone flies to the centroid of its
own cell: what is nearer to it than to any neighbour, within its sensing radius, weighted by the
distance from its goal. Two rules undo what a centroid alone cannot: where the cell is cut while the
drone rests, the weight falls off faster (beta), and the goal is turned to the right (theta).
"""

from __future__ import annotations

import math

import numpy as np

from companion.control.baselines.config import RblConfig
from companion.control.baselines.surroundings import Surroundings, turned_right
from mavlink_bridge.shared.arrays import Vector, norm

_STEP = 0.1  # s, the companion's tick
_GRID = 41  # points across the sensed disc
_STRAIGHT = math.pi / 2  # rad, the most that a goal is turned


class Rbl:
    """The velocity towards the centroid of the cell; remembers how the last ones were cut."""

    def __init__(self, config: RblConfig, radius: float) -> None:
        """radius: m, of a drone."""
        self._config, self._radius = config, radius + config.margin
        line = np.linspace(-config.reach, config.reach, _GRID)
        x, y = np.meshgrid(line, line)
        inside = np.hypot(x, y) <= config.reach
        self._disc: Vector = np.column_stack([x[inside], y[inside]])
        self.reset()

    def reset(self) -> None:
        """Forget how the cells were cut."""
        self._beta, self._theta = self._config.beta, 0.0

    def velocity(self, around: Surroundings) -> Vector:
        """Return the velocity (2,) m/s towards the centroid of the cell."""
        c = self._config
        speed = norm(around.migration)
        goal = c.reach * around.migration / max(speed, 1e-9) * min(1.0, speed / c.at_goal)
        cell = self._disc[self._free(around)]
        if not len(cell):
            return np.zeros(2)
        turned = turned_right(goal, self._theta)
        here, alone = self._centroid(cell, turned), self._centroid(self._disc, turned)
        straight = self._centroid(cell, goal)
        cut = norm(here - alone)
        self._adapt(norm(here), cut, norm(straight))
        v: Vector = c.gain * here
        # To the goal as fast as is asked for; out of another's way as fast as may be flown.
        most = speed + (around.fastest - speed) * min(1.0, cut / c.cut)
        return v * min(1.0, most / max(norm(v), 1e-9))

    def _free(self, around: Surroundings) -> Vector:
        """Return which points of the disc (n,) are in the cell."""
        free = np.ones(len(self._disc), bool)
        for place in around.neighbours:
            apart = max(norm(place), 1e-3)
            # Half way, or nearer where half would not leave room for both bodies.
            free &= self._disc @ (place / apart) <= min(0.5 * apart, apart - 2.0 * self._radius)
        for place in around.surfaces:
            apart = max(norm(place), 1e-3)
            free &= self._disc @ (place / apart) <= apart - self._radius
        return free

    def _centroid(self, cell: Vector, goal: Vector) -> Vector:
        """Return the centroid (2,) m of points (n,2), weighted by their distance from the goal."""
        off = cell - goal
        far = np.sqrt((off * off).sum(axis=1))
        weight = np.exp((far.min() - far) / self._beta)
        result: Vector = weight @ cell / weight.sum()
        return result

    def _adapt(self, way: float, cut: float, straight: float) -> None:
        """Turn the goal and sharpen the weight while the cell is cut and the drone rests.

        way: m, to the centroid. cut: m, from it to that without neighbours. straight: m, to the
        centroid with the goal where it is.
        """
        c = self._config
        rests = way < c.rests and cut > c.cut
        aim = c.beta_least if rests else c.beta
        self._beta += _STEP * (aim - self._beta)
        step = _STEP * c.turn_rate
        self._theta = min(self._theta + step, _STRAIGHT) if rests else max(self._theta - step, 0.0)
        if self._theta == _STRAIGHT and straight > way:
            self._theta = 0.0
