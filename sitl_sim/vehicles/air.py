"""The air and the ground around each vehicle: turbulence, downwash, ground effect, slopes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sitl_sim.vehicles.downwash import THRUST_LOSS, downwash, ground_gain
from sitl_sim.vehicles.rigid_body import MOTOR_X, MOTOR_Y, Vehicles
from sitl_sim.vehicles.turbulence import Strength, Turbulence
from sitl_sim.worlds.ground import Ground

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AirModel:
    """Which effects of the air there are; none by default."""

    turbulence: Strength = "none"
    downwash: bool = False
    ground_effect: bool = False


class Surroundings:
    """Air and ground around n vehicles, updated every 10 ms; `gusts` (n,3) m/s or None."""

    def __init__(
        self,
        vehicles: Vehicles,
        system_ids: Sequence[int],
        model: AirModel,
        ground: Ground,
        seed: int,
    ) -> None:
        self._vehicles, self._model, self._ground = vehicles, model, ground
        self._turbulence = (
            None if model.turbulence == "none" else Turbulence(model.turbulence, system_ids, seed)
        )
        frames = vehicles.airframes
        self._rotor_radius = np.array([a.rotor_radius for a in frames])
        self._width = np.array([2.0 * (a.arm + a.rotor_radius) for a in frames])
        arms = np.array([a.arm * math.sqrt(0.5) for a in frames])
        rotors = np.column_stack([MOTOR_X, MOTOR_Y, np.zeros(4)])
        self._rotors = arms[:, None, None] * rotors  # (n,4,3) m, body
        self._lost = np.zeros(len(frames))  # share of thrust
        self.gusts: Floats | None = None

    def step(self, dt: float, wind: Floats) -> None:
        """Step by dt [s]; wind: (n,3) m/s, world, without gusts."""
        vehicles = self._vehicles
        p, body = vehicles.p, vehicles.body
        if not self._ground.flat:
            set_planes(body.ground, self._ground, p)
        model, air = self._model, None
        if self._turbulence is not None or model.ground_effect:
            height = p[:, 2] - self._ground.height(p[:, 0], p[:, 1])
            if model.ground_effect:
                body.lift[:] = ground_gain(height, self._rotor_radius)
            if self._turbulence is not None:
                air = self._turbulence.step(dt, height, wind, vehicles.v)
        if model.downwash and len(p) > 1:
            wash = self._wash()
            air = wash if air is None else air + wash
            if not model.ground_effect:
                body.lift[:] = 1.0
            body.lift[:] *= 1.0 - self._lost
        self.gusts = air

    def _wash(self) -> Floats:
        """Return the downwash (n,3) m/s at each vehicle; set its torques and losses of thrust."""
        vehicles = self._vehicles
        body, turn = vehicles.body, _rotations(vehicles.q)
        thrust = (body.thrust_max * vehicles.motor**2).sum(axis=1)
        places = vehicles.p[:, None] + np.einsum("nij,nkj->nki", turn, self._rotors)
        air = downwash(vehicles.p, turn[:, :, 2], thrust, self._width, places)
        mean: Floats = air.mean(axis=1)
        along = np.einsum("nkj,nj->nk", air, turn[:, :, 2])
        self._lost = np.minimum(-THRUST_LOSS * along.mean(axis=1), 1.0)
        # A quarter of the vertical drag and of the thrust acts at each rotor.
        size = np.linalg.norm(mean, axis=1)
        drag = body.drag_linear[:, 2] + body.drag_quadratic * size + THRUST_LOSS * thrust
        force = drag[:, None] / 4.0 * (along - along.mean(axis=1, keepdims=True))
        body.torque[:, 0] = (self._rotors[:, :, 1] * force).sum(axis=1)
        body.torque[:, 1] = -(self._rotors[:, :, 0] * force).sum(axis=1)
        return mean


def set_planes(planes: Floats, ground: Ground, p: Floats) -> None:
    """Set each row of `planes` (n,3) to the ground's plane at p (n,3) m: z = a + b·x + c·y."""
    height, east, north = ground.plane(p[:, 0], p[:, 1])
    planes[:, 0] = height - east * p[:, 0] - north * p[:, 1]
    planes[:, 1], planes[:, 2] = east, north


def _rotations(q: Floats) -> Floats:
    """Return the rotation matrices (n,3,3), body → world, of q (n,4)."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrices: Floats = np.moveaxis(np.array(rows), -1, 0)
    return matrices
