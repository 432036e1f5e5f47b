"""Parameters of the generated functions: the weights, the scene, the stages.

Three vectors: `weights` (per config), `scene` (per tick) and `stages` (per tick, one row for each
of the steps 1…N). A `Table` says once which slice of a vector each name has; the symbols and the
numbers are both made from it. Positions are relative to the drone's own, so that the numbers stay
small far from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from mavlink_bridge.shared.arrays import Vector

if TYPE_CHECKING:
    import casadi as ca

Shape = tuple[int, ...]
Weights: TypeAlias = "Mapping[str, ca.SX]"


class Table:
    """The layout of one vector: the slice of each named part.

    slices: by name. size: length of the vector. A part of shape (n,m) is n rows of m numbers; as
    CasADi counts column by column, its symbol of the same part is (m,n).
    """

    def __init__(self, shapes: Mapping[str, Shape]) -> None:
        self._shapes = dict(shapes)
        self.slices: dict[str, slice] = {}
        self.size = 0
        for name, shape in self._shapes.items():
            self.slices[name] = slice(self.size, self.size + math.prod(shape))
            self.size = self.slices[name].stop

    def symbols(self, name: str) -> tuple[ca.SX, dict[str, ca.SX]]:
        """Return the symbol of the whole vector, called `name`, and the symbol of each part."""
        import casadi as ca

        vector = ca.SX.sym(name, self.size)
        parts = {}
        for part, shape in self._shapes.items():
            rows, columns = (*shape[::-1], 1, 1)[:2]
            parts[part] = ca.reshape(vector[self.slices[part]], rows, columns)
        return vector, parts

    def views(self, vectors: Vector) -> dict[str, Vector]:
        """Return each part (...,*shape) of vectors (...,size), in place."""
        parts = {}
        for name, shape in self._shapes.items():
            part = vectors[..., self.slices[name]]
            parts[name] = part.reshape((*vectors.shape[:-1], *shape))
            assert np.shares_memory(parts[name], vectors) or not part.size
        return parts


WEIGHTS = Table(
    dict.fromkeys(
        (
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
        ),
        (),
    )
)


def weight_symbols() -> tuple[ca.SX, Weights]:
    """Return the symbol of the weight vector, and its entries by name."""
    return WEIGHTS.symbols("weights")


def weight_numbers(config: NmpcConfig) -> Vector:
    """Return the weight vector of a config."""
    numbers = np.zeros(WEIGHTS.size)
    for name, number in WEIGHTS.views(numbers).items():
        number[...] = getattr(config, name)
    return numbers


def scene_table(config: NmpcConfig) -> Table:
    """Return the layout of `scene`: what all stages of a tick share."""
    return Table(
        {
            "goal": (3,),
            "speed": (),
            "sight": (2,),
            "disturbance": (3,),
            "v_max": (),
            "cylinders": (config.cylinders, 3),
            "cylinder_active": (config.cylinders,),
            "planes": (config.planes, 4),
            "plane_active": (config.planes,),
        }
    )


def stage_table(config: NmpcConfig) -> Table:
    """Return the layout of a row of `stages`: what differs from stage to stage."""
    return Table(
        {
            "neighbour_p": (config.neighbours, 3),
            "neighbour_safety": (config.neighbours,),
            "neighbour_active": (config.neighbours,),
            "cohesion": (config.neighbours,),
        }
    )


@dataclass(frozen=True)
class Scene:
    """Symbols of one stage: the parts of `scene_table` and `stage_table`.

    goal (3,1) m and neighbour_p (3,J) m are relative to the drone; neighbour_p is predicted for
    this stage, (13), (14). speed: C of (18) [m/s]. v_max: m/s, of (32). sight (2,1): unit vector
    along (7). disturbance (3,1): m/s². cylinders (3,K): x, y, radius [m]. planes (4,H): n, b.
    neighbour_safety (J,1): m, of (37). *_active: 0 or 1. cohesion (J,1): share w_short/N_i of (29).
    """

    goal: ca.SX
    speed: ca.SX
    sight: ca.SX
    disturbance: ca.SX
    v_max: ca.SX
    cylinders: ca.SX
    cylinder_active: ca.SX
    planes: ca.SX
    plane_active: ca.SX
    neighbour_p: ca.SX
    neighbour_safety: ca.SX
    neighbour_active: ca.SX
    cohesion: ca.SX

    @property
    def neighbours(self) -> int:
        """Return the number of neighbours, active or not."""
        return int(self.neighbour_p.shape[1])

    @property
    def cylinder_count(self) -> int:
        """Return the number of cylinders, active or not."""
        return int(self.cylinders.shape[1])

    @property
    def plane_count(self) -> int:
        """Return the number of half-spaces, active or not."""
        return int(self.planes.shape[1])


def scene_symbols(config: NmpcConfig) -> tuple[ca.SX, ca.SX, Scene]:
    """Return the symbols of the scene vector and of one stage's vector, and their parts."""
    scene, shared = scene_table(config).symbols("scene")
    stage, own = stage_table(config).symbols("stage")
    return scene, stage, Scene(**shared, **own)


class ParameterVectors:
    """The scene and stage vectors of instances, filled in place.

    scene (size,): laid out by `scene_table`. stages (N,size): laid out by `stage_table`.
    of_scene, of_stages: their parts by name.
    """

    def __init__(self, config: NmpcConfig) -> None:
        self.config = config
        k = np.arange(1, config.N + 1)
        self._time = (k * config.dt)[:, None]
        self._constrained = (k <= config.M_constraint).astype(float)[:, None]
        self._cohesive = (k <= config.M).astype(float)[:, None]
        scene, stage = scene_table(config), stage_table(config)
        self.scene, self.stages = np.zeros(scene.size), np.zeros((config.N, stage.size))
        self.of_scene, self.of_stages = scene.views(self.scene), stage.views(self.stages)

    def fill(self, instance: Instance) -> None:
        """Set both vectors to the numbers of `instance`; positions become relative to the drone."""
        origin, scene = instance.x0[:3], self.of_scene
        goal = scene["goal"]
        np.subtract(instance.goal, origin, out=goal)
        scene["speed"][...] = instance.speed
        yaw = float(instance.yaw)
        finite = math.isfinite(yaw)
        scene["sight"][0] = math.cos(yaw) if finite else math.nan
        scene["sight"][1] = math.sin(yaw) if finite else math.nan
        scene["disturbance"][:] = instance.disturbance
        scene["v_max"][...] = instance.v_max
        self._fill_obstacles(instance, origin, goal)
        self._fill_neighbours(instance, origin, goal)

    def _fill_obstacles(self, instance: Instance, origin: Vector, goal: Vector) -> None:
        cylinders, planes = self.of_scene["cylinders"], self.of_scene["planes"]
        cylinders[:] = instance.cylinders
        cylinders[:, :2] -= origin[:2]
        _move_aside(cylinders, goal[:2], self.config.tie_break)
        self.of_scene["cylinder_active"][:] = instance.cylinder_active
        planes[:] = instance.planes
        planes[:, 3] -= instance.planes[:, :3] @ origin
        self.of_scene["plane_active"][:] = instance.plane_active

    def _fill_neighbours(self, instance: Instance, origin: Vector, goal: Vector) -> None:
        """Predict at constant velocity, (13), (14); uncertainty widens the safety distance."""
        config, stages = self.config, self.of_stages
        p, v = instance.neighbour_p - origin, instance.neighbour_v
        far = max(math.hypot(goal[0], goal[1]), 1e-6)
        heading = goal[:2] * (instance.speed / far)
        for j in range(len(p)):
            _move_aside(p[j : j + 1], heading - v[j, :2], config.tie_break)
        stages["neighbour_p"][:] = p + self._time[:, :, None] * v
        sigma_p, sigma_v = instance.neighbour_sigma.T
        widening = config.kappa * np.hypot(sigma_p, self._time * sigma_v)
        safety = stages["neighbour_safety"]
        np.minimum(widening, config.widening_max, out=safety)
        safety += config.d_agent_safety
        active = instance.neighbour_active
        np.multiply(self._constrained, active, out=stages["neighbour_active"])
        stay_with = instance.neighbour_cohesion * active
        share = stay_with / max(1.0, float((stay_with > 0.0).sum()))
        np.multiply(self._cohesive, share, out=stages["cohesion"])


def _move_aside(positions: Vector, heading: Vector, tie_break: float) -> None:
    """Move what lies dead ahead to the left of the heading, in place: the drone passes right of it.

    positions (n, 2 or more) m, relative to the drone. heading (2,): direction of motion. On the
    exact line both sides are equally good and no descent direction leads to either: the drone would
    brake and stay. Both of two drones that meet give way to their right. The shift is at most
    2·tie_break [m].
    """
    length = math.hypot(heading[0], heading[1])
    if not length > 1e-6:
        return
    x, y = float(heading[0]) / length, float(heading[1]) / length
    for n, (px, py) in enumerate(positions[:, :2].tolist()):
        lateral = x * py - y * px
        if -tie_break < lateral < tie_break and x * px + y * py > 0.0:
            positions[n, 0] -= y * (tie_break - lateral)
            positions[n, 1] += x * (tie_break - lateral)
