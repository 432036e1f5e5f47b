"""What the generated functions take besides the variables: weights, the scene, the stages.

Three vectors, each with one layout that both the symbols and the numbers are made from:
`weights` (per config), `scene` (per tick), `stages` (per tick, one column for each of 1…N).
Places are relative to the drone's own, so that the numbers stay small far from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from mavlink_bridge.shared.arrays import Vector

WEIGHTS = (
    "climb_speed",
    "goal_smoothing",
    "d_ref",
    "d_obstacle_safety",
    "agent_vertical_scale",
    "v_blind",
    "seen_cone",
    "crowding",
    "w_short",
    "w_mig",
    "w_c1",
    "w_c2",
    "w_c3",
    "w_c4",
    "w_yaw",
    "w_v",
    "w_blind",
    "eps_cohesion",
    "eps_mig",
    "eps_c",
    "eps_yaw",
    "eps_omega",
)

Weights = Mapping[str, ca.SX]


def weight_symbols() -> tuple[ca.SX, Weights]:
    """Symbol of the weight vector, and its entries by name."""
    symbol = ca.SX.sym("weights", len(WEIGHTS))
    return symbol, {name: symbol[i] for i, name in enumerate(WEIGHTS)}


def weight_numbers(config: NmpcConfig) -> Vector:
    """The config's numbers in the order of WEIGHTS."""
    return np.array([float(getattr(config, name)) for name in WEIGHTS])


@dataclass(frozen=True)
class Scene:
    """Symbols of one stage: the scene, and where the neighbours are by then."""

    goal: ca.SX
    speed: ca.SX
    v_max: ca.SX
    sight: ca.SX
    disturbance: ca.SX
    cylinders: ca.SX
    cylinder_active: ca.SX
    planes: ca.SX
    plane_active: ca.SX
    neighbour_p: ca.SX
    neighbour_safety: ca.SX
    neighbour_active: ca.SX
    cohesion: ca.SX
    migration: ca.SX

    @property
    def neighbours(self) -> int:
        """Number of neighbours, active or not."""
        return int(self.neighbour_p.shape[1])

    @property
    def cylinder_count(self) -> int:
        """Number of cylinders, active or not."""
        return int(self.cylinders.shape[1])

    @property
    def plane_count(self) -> int:
        """Number of half-spaces, active or not."""
        return int(self.planes.shape[1])


def scene_symbols(config: NmpcConfig) -> tuple[ca.SX, ca.SX, Scene]:
    """Symbols of the scene vector and of one stage's vector, and what they hold."""
    shapes = {
        "goal": (3, 1),
        "speed": (1, 1),
        "sight": (2, 1),
        "disturbance": (3, 1),
        "v_max": (1, 1),
        "cylinders": (3, config.cylinders),
        "cylinder_active": (config.cylinders, 1),
        "planes": (4, config.planes),
        "plane_active": (config.planes, 1),
    }
    stage_shapes = {
        "neighbour_p": (3, config.neighbours),
        "neighbour_safety": (config.neighbours, 1),
        "neighbour_active": (config.neighbours, 1),
        "cohesion": (config.neighbours, 1),
        "migration": (1, 1),
    }
    scene = {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}
    stage = {name: ca.SX.sym(name, *shape) for name, shape in stage_shapes.items()}
    return (
        ca.vertcat(*[ca.vec(s) for s in scene.values()]),
        ca.vertcat(*[ca.vec(s) for s in stage.values()]),
        Scene(**scene, **stage),
    )


class Numbers:
    """Fills the scene and stage vectors of instances; arrays that stay in place.

    scene (size,), stages (N, size): in the layout of `scene_symbols`.
    """

    def __init__(self, config: NmpcConfig) -> None:
        self.config = config
        N, J, K, H = config.N, config.neighbours, config.cylinders, config.planes
        k = np.arange(1, N + 1)
        self._time = (k * config.dt)[:, None]
        self._constrained = (k <= config.M_constraint).astype(float)[:, None]
        self._cohesive = (k <= config.M).astype(float)[:, None]
        self.scene = np.zeros(10 + 4 * K + 5 * H)
        at = 10
        self._cylinders = self.scene[at : at + 3 * K].reshape(K, 3)
        self._cylinder_active = self.scene[at + 3 * K : at + 4 * K]
        at += 4 * K
        self._planes = self.scene[at : at + 4 * H].reshape(H, 4)
        self._plane_active = self.scene[at + 4 * H :]
        self.stages = np.zeros((N, 6 * J + 1))
        self._p = self.stages[:, : 3 * J]
        self._safety = self.stages[:, 3 * J : 4 * J]
        self._active = self.stages[:, 4 * J : 5 * J]
        self._cohesion = self.stages[:, 5 * J : 6 * J]
        self.stages[:, -1] = np.where(k == N, config.w_mig_end, 1.0)

    def fill(self, instance: Instance) -> None:
        """Set both vectors; places become relative to the drone."""
        origin = instance.x0[:3]
        goal = self.scene[:3]
        np.subtract(instance.goal, origin, out=goal)
        self.scene[3] = instance.speed
        yaw = float(instance.yaw)
        sane = math.isfinite(yaw)
        self.scene[4] = math.cos(yaw) if sane else math.nan
        self.scene[5] = math.sin(yaw) if sane else math.nan
        self.scene[6:9] = instance.disturbance
        self.scene[9] = instance.v_max
        self._fill_obstacles(instance, origin, goal)
        self._fill_neighbours(instance, origin, goal)

    def _fill_obstacles(self, instance: Instance, origin: Vector, goal: Vector) -> None:
        self._cylinders[:] = instance.cylinders
        self._cylinders[:, :2] -= origin[:2]
        _move_aside(self._cylinders, goal[:2], self.config.tie_break)
        self._cylinder_active[:] = instance.cylinder_active
        self._planes[:] = instance.planes
        self._planes[:, 3] -= instance.planes[:, :3] @ origin
        self._plane_active[:] = instance.plane_active

    def _fill_neighbours(self, instance: Instance, origin: Vector, goal: Vector) -> None:
        """Constant-velocity prediction, (13), (14); uncertainty widens the safety distance."""
        config = self.config
        p, v = instance.neighbour_p - origin, instance.neighbour_v
        far = max(math.hypot(goal[0], goal[1]), 1e-6)
        heading = goal[:2] * (instance.speed / far)
        for j in range(len(p)):
            _move_aside(p[j : j + 1], heading - v[j, :2], config.tie_break)
        self._p[:] = p.ravel() + self._time * v.ravel()
        place, speed = instance.neighbour_sigma.T
        widening = config.kappa * np.hypot(place, self._time * speed)
        np.minimum(widening, config.widening_max, out=self._safety)
        self._safety += config.d_agent_safety
        active = instance.neighbour_active
        np.multiply(self._constrained, active, out=self._active)
        stay_with = instance.neighbour_cohesion * active
        share = stay_with / max(1.0, float((stay_with > 0.0).sum()))
        np.multiply(self._cohesive, share, out=self._cohesion)


def _move_aside(places: Vector, towards: Vector, tie_break: float) -> None:
    """Move what lies dead ahead to the left of the way, in place, so that one passes right.

    places (n, 2 or more) relative to the drone, towards (2,) direction of the way. On the exact
    line both sides are equally good and no descent direction leads to either: the drone would
    brake and stay. Both of two drones that meet give way to their right. At most 2·tie_break.
    """
    length = math.hypot(towards[0], towards[1])
    if not length > 1e-6:
        return
    x, y = float(towards[0]) / length, float(towards[1]) / length
    for n, (px, py) in enumerate(places[:, :2].tolist()):
        lateral = x * py - y * px
        if -tie_break < lateral < tie_break and x * px + y * py > 0.0:
            places[n, 0] -= y * (tie_break - lateral)
            places[n, 1] += x * (tie_break - lateral)
