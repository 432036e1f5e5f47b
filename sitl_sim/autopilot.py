"""n emulated autopilots on n vehicles: messages in, messages out, no sockets and no clock.

Physics and rate loops run at 1 kHz, outer loops and modes at 100 Hz, in simulated time that
`advance` moves on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavlink_bridge.messages import Message, Received, StatusText
from sitl_sim.estimator import BLOCK_SUBSTEPS, TICK_SUBSTEPS, Estimator, SensorNoise
from sitl_sim.flavours import Mode, flavour_of
from sitl_sim.geodesy import GeoReference, LocalFrame
from sitl_sim.kernel import fly, observe, steer
from sitl_sim.outer_loops import OuterGains, make_setpoints
from sitl_sim.power import Batteries
from sitl_sim.protocol import answer
from sitl_sim.rates import RateGains, make_rate_loop
from sitl_sim.unit import Shared, Unit
from sitl_sim.vehicle import SUBSTEP, Vehicles

Floats = NDArray[np.float64]

COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
BATTERY_TICKS = 10


class Autopilots:
    """One autopilot per vehicle; every index i is the vehicle's."""

    def __init__(
        self,
        vehicles: Vehicles,
        system_ids: Sequence[int],
        flavour: str | Sequence[str] = "px4",
        *,
        origin: ArrayLike | None = None,
        yaw_offset: ArrayLike = 0.0,
        boot_offset: ArrayLike = 0.0,
        seed: int = 0,
        reference: GeoReference | None = None,
        noise: SensorNoise | None = None,
        parameters: Mapping[str, float] | None = None,
        rate_gains: RateGains | None = None,
        outer_gains: OuterGains | None = None,
        battery_ah: float = 1.5,
    ) -> None:
        """Switch them on.

        flavour: one for all or one each. origin: (n,3) m, world, where each vehicle's own frame
        begins (default: where it stands). yaw_offset: (n,) rad, world, direction of its own
        east. boot_offset: (n,) s, time_boot = t + boot_offset. reference: where the world lies.
        parameters: overrides by name, for those whose flavour knows the name.
        """
        n = len(vehicles)
        names = [flavour] * n if isinstance(flavour, str) else list(flavour)
        if not len(system_ids) == len(names) == n:
            raise ValueError(f"{n} vehicles, {len(system_ids)} ids, {len(names)} flavours")
        if len(set(system_ids)) != n:
            raise ValueError(f"two vehicles with one system id in {list(system_ids)}")
        self.vehicles = vehicles
        self._estimator = Estimator(list(system_ids), [noise or SensorNoise()] * n, seed)
        self._shared = Shared(
            state=vehicles.state,
            loop=make_rate_loop([rate_gains or RateGains()] * n, vehicles.airframes),
            setpoints=make_setpoints(np.zeros(n), outer_gains or OuterGains()),
            estimate=self._estimator.estimate,
            batteries=Batteries(n, battery_ah),
        )
        origins = np.broadcast_to(vehicles.p if origin is None else np.asarray(origin), (n, 3))
        yaws = np.broadcast_to(np.asarray(yaw_offset, dtype=np.float64), (n,))
        boots = np.broadcast_to(np.asarray(boot_offset, dtype=np.float64), (n,))
        place = reference or GeoReference()
        self.units: list[Unit] = []
        for i in range(n):
            style = flavour_of(names[i])
            overrides = style.defaults_for(vehicles.airframes[i], system_ids[i])
            overrides |= dict(parameters or {})
            frame = LocalFrame(origins[i].copy(), float(yaws[i]), place)
            unit = Unit(i, system_ids[i], style, frame, float(boots[i]), self._shared, overrides)
            self.units.append(unit)
        self._substeps = 0  # since the start; the clock
        observe(vehicles.state, self._shared.estimate, self._estimator.gyro_noise, 0)

    @property
    def t(self) -> float:
        """Simulated seconds since the start."""
        return self._substeps * SUBSTEP

    @property
    def armed(self) -> NDArray[np.bool_]:
        """(n,) motors may turn."""
        return np.array([u.commander.armed for u in self.units])

    @property
    def landed(self) -> NDArray[np.bool_]:
        """(n,) on the ground and at rest."""
        return np.array([u.commander.landed for u in self.units])

    @property
    def mode(self) -> list[Mode]:
        """What each vehicle does."""
        return [u.commander.mode for u in self.units]

    def status_texts(self, i: int) -> list[StatusText]:
        """All that vehicle i said since the start."""
        return list(self.units[i].commander.texts)

    def advance(self, t_end: float, wind: ArrayLike = 0.0) -> None:
        """Run on to t_end [s], a multiple of 1 ms; wind: (3,) or (n,3) m/s, world."""
        air = np.ascontiguousarray(
            np.broadcast_to(np.asarray(wind, dtype=np.float64), self.vehicles.p.shape)
        )
        end = round(t_end / SUBSTEP)
        while self._substeps < end:
            place = self._substeps % BLOCK_SUBSTEPS
            if place % TICK_SUBSTEPS == 0:
                self._tick(place)
            count = min(TICK_SUBSTEPS - place % TICK_SUBSTEPS, end - self._substeps)
            self._fly(air, place, count)
            self._substeps += count
        self.vehicles.t = self.t
        self._observe()

    def _fly(self, wind: Floats, first: int, count: int) -> None:
        s, v = self._shared, self.vehicles
        noise = self._estimator.gyro_noise
        fly(v.state, v.body, s.loop, s.setpoints, s.estimate, noise, wind, first, count)

    def _tick(self, place: int) -> None:
        """Every 10 ms: sensors, batteries, modes, outer loops."""
        ticks = self._substeps // TICK_SUBSTEPS
        if place == 0 and self._substeps > 0:
            self._estimator.next_block()
        self._estimator.wander(place // TICK_SUBSTEPS)
        self._observe()
        if ticks % BATTERY_TICKS == 0:
            self._shared.batteries.drain(self.vehicles, BATTERY_TICKS * TICK_SUBSTEPS * SUBSTEP)
            for unit in self.units:
                unit.compensate_battery(float(self.vehicles.body.motor_gain[unit.i]))
        now = self.t
        for unit in self.units:
            unit.commander.tick(now)
        steer(self._shared.setpoints, self._shared.estimate)

    def _observe(self) -> None:
        place = self._substeps % BLOCK_SUBSTEPS
        observe(self.vehicles.state, self._shared.estimate, self._estimator.gyro_noise, place)

    def receive(self, i: int, received: Received, link: str | None = None) -> list[Message]:
        """Vehicle i takes a message at the present time; replies go back by the asking link.

        link: "companion" or "gcs", where the caller knows it; else the sender's component tells.
        """
        unit = self.units[i]
        self._set_clock(unit)
        if link is None:
            own = received.source.component == COMPANION or received.source.system == unit.system
            link = "companion" if own else "gcs"
        return answer(unit, received, link)

    def telemetry(self, i: int, link: str) -> list[Message]:
        """Messages of vehicle i that are due now on link "companion" or "gcs"."""
        unit = self.units[i]
        self._set_clock(unit)
        return unit.telemetry(link)

    def _set_clock(self, unit: Unit) -> None:
        unit.now_us = self._substeps * 1000
        unit.commander.now = unit.guidance.now = self.t
