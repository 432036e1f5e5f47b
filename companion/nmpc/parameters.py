"""What the generated functions take besides the variables: weights, the scene, the stages.

Three vectors, each with one layout that both the symbols and the numbers are made from:
`weights` (per config), `scene` (per tick), `stages` (per tick, one column for each of 1…N).
Places are relative to the drone's own, so that the numbers stay small far from the origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from companion.model import Vector
from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance

WEIGHTS = (
    "climb_speed",
    "goal_smoothing",
    "d_ref",
    "d_obstacle_safety",
    "agent_vertical_scale",
    "v_max",
    "w_short",
    "w_mig",
    "w_c1",
    "w_c2",
    "w_c3",
    "w_c4",
    "w_yaw",
    "w_v",
    "eps_mig",
    "eps_c",
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


def scene_numbers(config: NmpcConfig, instance: Instance) -> Vector:
    """The scene vector of an instance."""
    origin = instance.x0[:3]
    cylinders = instance.cylinders - np.append(origin[:2], 0.0)
    planes = instance.planes.copy()
    planes[:, 3] -= planes[:, :3] @ origin
    goal = instance.goal - origin
    cylinders[:, :2] += _aside(cylinders[:, :2], goal[:2], config.tie_break)
    return np.concatenate(
        [
            goal,
            [instance.speed, np.cos(instance.yaw), np.sin(instance.yaw)],
            instance.disturbance,
            cylinders.ravel(),
            instance.cylinder_active,
            planes.ravel(),
            instance.plane_active,
        ]
    )


def stage_numbers(config: NmpcConfig, instance: Instance) -> Vector:
    """The stage vectors (size, N) of an instance: constant-velocity prediction, (13), (14).

    Uncertainty widens the safety distance by kappa standard deviations, growing with time.
    """
    k = np.arange(1, config.N + 1)
    time = k * config.dt
    goal = instance.goal - instance.x0[:3]
    p, v = instance.neighbour_p - instance.x0[:3], instance.neighbour_v
    heading = goal[:2] * (instance.speed / max(float(np.hypot(goal[0], goal[1])), 1e-6))
    p = p.copy()
    p[:, :2] += _aside(p[:, :2], heading - v[:, :2], config.tie_break)
    predicted = p[None] + v[None] * time[:, None, None]
    sigma_p, sigma_v = instance.neighbour_sigma[:, 0], instance.neighbour_sigma[:, 1]
    widening = config.kappa * np.hypot(sigma_p, time[:, None] * sigma_v)
    active = instance.neighbour_active
    share = instance.neighbour_cohesion * active / max(1.0, float(active.sum()))
    return np.concatenate(
        [
            predicted.reshape(config.N, -1),
            config.d_agent_safety + np.minimum(widening, config.widening_max),
            (k <= config.M_constraint)[:, None] * active,
            (k <= config.M)[:, None] * share,
            np.where(k == config.N, config.w_mig_end, 1.0)[:, None],
        ],
        axis=1,
    ).T


def _aside(places: Vector, towards: Vector, tie_break: float) -> Vector:
    """Shift that takes what lies dead ahead to the left of the way, so that one passes right.

    places (n,2) relative to the drone, towards (2,) or (n,2) direction of the way. On the exact
    line both sides are equally good and no descent direction leads to either: the drone would
    brake and stay. Both of two drones that meet give way to their right. At most 2·tie_break.
    """
    towards = np.broadcast_to(towards, places.shape)
    length = np.sqrt((towards**2).sum(axis=1))
    unit = towards / np.maximum(length, 1e-6)[:, None]
    left = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    lateral = (places * left).sum(axis=1)
    tied = (np.abs(lateral) < tie_break) & ((places * unit).sum(axis=1) > 0.0)
    return left * (tied * (tie_break - lateral))[:, None]
