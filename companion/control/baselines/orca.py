"""ORCA by its authors' library RVO2.

Source: van den Berg et al., "Reciprocal n-body collision avoidance", ISRR 2011. Each drone solves
its own step, with the neighbours in its view, as they move.
"""

from __future__ import annotations

import math

import numpy as np
import pyrvo

from companion.control.baselines.config import OrcaConfig
from companion.control.baselines.surroundings import Surroundings, turned_right
from mavlink_bridge.shared.arrays import Vector

_STEP = 0.1  # s, the companion's tick
_CORNERS = 8  # of the polygon around a trunk
_WALL = 20.0  # m of wall, centred on its nearest point


class Orca:
    """The velocity nearest to the preferred one that is free of collision if all do the same."""

    def __init__(self, config: OrcaConfig) -> None:
        self._config = config

    def velocity(self, around: Surroundings) -> Vector:
        """Return the velocity (2,) m/s by one step of RVO2, in which the drone is agent 0."""
        c = self._config
        reach = 15.0
        sim = pyrvo.RVOSimulator(
            _STEP, reach, 12, c.horizon, c.horizon_obstacle, c.radius, around.fastest
        )
        sim.add_agent((0.0, 0.0))
        sim.set_agent_velocity(0, tuple(around.v.tolist()))
        sim.set_agent_pref_velocity(0, tuple(turned_right(around.migration, c.aside).tolist()))
        places = zip(around.neighbours.tolist(), around.velocities.tolist(), strict=True)
        for k, (offset, velocity) in enumerate(places, start=1):
            sim.add_agent(tuple(offset))
            sim.set_agent_velocity(k, tuple(velocity))
            sim.set_agent_pref_velocity(k, tuple(velocity))
        for polygon in [*_trunks(around.trunks), *_walls(around.walls)]:
            sim.add_obstacle(polygon)
        sim.process_obstacles()
        sim.do_step()
        chosen = sim.get_agent_velocity(0)
        return np.array([chosen.x, chosen.y])


def _trunks(trunks: Vector) -> list[list[tuple[float, float]]]:
    """Return polygons around the trunks (c,3), counter-clockwise."""
    turn = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) / math.cos(math.pi / _CORNERS)
    return [[(float(a), float(b)) for a, b in ring * r + (x, y)] for x, y, r in trunks]


def _walls(walls: Vector) -> list[list[tuple[float, float]]]:
    """Return the walls (h,3) as long thin blocks behind their surface, counter-clockwise."""
    blocks = []
    for nx, ny, room in walls.tolist():
        normal, along = np.array([nx, ny]), np.array([-ny, nx]) * (_WALL / 2)
        near, far = normal * room, normal * (room + 0.5)
        corners = [near + along, near - along, far - along, far + along]
        blocks.append([(float(a), float(b)) for a, b in corners])
    return blocks
