"""n emulated autopilots on n vehicles: messages in, messages out, no sockets and no clock.

Physics and rate loops run at 1 kHz, outer loops and modes at 100 Hz, in simulated time that
`advance` moves on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavlink_bridge.wire.ids import ComponentId, MessageId
from mavlink_bridge.wire.messages import Message, Received
from sitl_sim.vehicles.air import AirModel, Surroundings, set_planes
from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.battery import Batteries
from sitl_sim.vehicles.estimator import BLOCK_SUBSTEPS, TICK_SUBSTEPS, Estimator
from sitl_sim.vehicles.firmware.betaflight_quirks import QUIRKS
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.flavours import flavour_of
from sitl_sim.vehicles.firmware.late_samples import LateSamples, TelemetryLag
from sitl_sim.vehicles.firmware.protocol import answer
from sitl_sim.vehicles.firmware.streams import BUILDERS, SENSORS
from sitl_sim.vehicles.firmware.unit import Shared, Unit
from sitl_sim.vehicles.grades import GRADES, Grade
from sitl_sim.vehicles.kernel import fly, observe, steer
from sitl_sim.vehicles.outer_loops import Control, OuterGains, make_setpoints
from sitl_sim.vehicles.rangefinder import Rangefinder
from sitl_sim.vehicles.rates import make_rate_loop
from sitl_sim.vehicles.rigid_body import SUBSTEP, Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise
from sitl_sim.vehicles.state_errors import StateErrors
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame
from sitl_sim.worlds.ground import Ground

Floats = NDArray[np.float64]

BATTERY_TICKS = 10
FEET = 1e-6  # m: a vehicle whose feet are this close to the ground stands on it


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
        rate_gains: RateGains | Sequence[RateGains] | None = None,
        assumed: Sequence[Airframe] | None = None,
        outer_gains: OuterGains | None = None,
        grade: Grade = GRADES["mocap"],
        telemetry_lag: TelemetryLag | None = None,
        rangefinder: bool = False,
        ground: Ground | None = None,
        air: AirModel | None = None,
    ) -> None:
        """Switch the autopilots on.

        flavour: one for all or one each. origin: (n,3) m, world, origin of each vehicle's own
        frame (default: where it stands). yaw_offset: (n,) rad, world, direction of its own east.
        boot_offset: (n,) s, time_boot = t + boot_offset. reference: where the world lies on the
        Earth. assumed: airframes that mixers and hover thrust are set for (default: the true ones).
        parameters: overrides by name; in a mixed fleet for those flavours that have them.
        grade: of the state estimates; noise: instead of the grade's. ground: flat by default. air:
        calm by default.
        """
        n = len(vehicles)
        names = [flavour] * n if isinstance(flavour, str) else list(flavour)
        if not len(system_ids) == len(names) == n:
            raise ValueError(f"{n} vehicles, {len(system_ids)} ids, {len(names)} flavours")
        if len(set(system_ids)) != n:
            raise ValueError(f"two vehicles with one system id in {list(system_ids)}")
        self.vehicles = vehicles
        ground = ground or Ground({})
        self._surroundings = Surroundings(vehicles, system_ids, air or AirModel(), ground, seed)
        set_planes(vehicles.body.ground, ground, vehicles.p)
        feet = vehicles.p[:, 2] - ground.height(vehicles.p[:, 0], vehicles.p[:, 1])
        vehicles.state.contact[:] = feet <= FEET
        self._estimator = Estimator(list(system_ids), [noise or grade.noise] * n, seed)
        self._errors = StateErrors(system_ids, [grade] * n, seed)
        self._late = LateSamples(
            system_ids, telemetry_lag, vehicles.state, self._estimator.estimate, seed
        )
        if rate_gains is None or isinstance(rate_gains, RateGains):
            gains = [rate_gains or RateGains()] * n
        else:
            gains = list(rate_gains)
        frames = list(assumed or vehicles.airframes)
        self._shared = Shared(
            state=vehicles.state,
            body=vehicles.body,
            loop=make_rate_loop(gains, frames),
            setpoints=make_setpoints(np.zeros(n), outer_gains or OuterGains()),
            estimate=self._estimator.estimate,
            batteries=Batteries(vehicles.airframes),
            errors=self._errors,
            late=self._late,
            rangefinder=Rangefinder(system_ids, [rangefinder] * n, ground, seed),
        )
        self._doubtful = grade is not GRADES["mocap"]
        origins = np.broadcast_to(vehicles.p if origin is None else np.asarray(origin), (n, 3))
        yaws = np.broadcast_to(np.asarray(yaw_offset, dtype=np.float64), (n,))
        boots = np.broadcast_to(np.asarray(boot_offset, dtype=np.float64), (n,))
        place = reference or GeoReference()
        wanted = dict(parameters or {})
        self._flavours = [flavour_of(name) for name in names]
        self._frames = [LocalFrame(origins[i].copy(), float(yaws[i]), place) for i in range(n)]
        known = {name for f in self._flavours for name in f.parameters}
        self._overrides = [
            f.defaults_for(frames[i], system_ids[i])
            | {k: v for k, v in wanted.items() if k in f.parameters or k not in known}
            for i, f in enumerate(self._flavours)
        ]
        self._substeps = 0  # since the start: the clock
        self._errors.next_block()
        observe(vehicles.state, self._shared.estimate, self._estimator.gyro_noise, 0)
        self.units = [self._boot(i, system_ids[i], float(boots[i])) for i in range(n)]

    def _boot(self, i: int, system: int, boot_offset: float) -> Unit:
        flavour, frame = self._flavours[i], self._frames[i]
        builders = BUILDERS | (QUIRKS if flavour.sticks else {})
        overrides = self._overrides[i]
        doubts = flavour.doubt_streams
        if not self._doubtful:  # a rangefinder tells what it measures in any case
            fitted = self._shared.rangefinder.fitted[i]
            doubts = {
                k: hz for k, hz in doubts.items() if fitted and k == MessageId.DISTANCE_SENSOR
            }
        more = {"companion": doubts} if doubts else {}
        return Unit(i, system, flavour, frame, boot_offset, self._shared, overrides, builders, more)

    @property
    def t(self) -> float:
        """Simulated seconds since the start."""
        return self._substeps * SUBSTEP

    @property
    def errors(self) -> StateErrors:
        """The slow errors of the state estimates; faults set them."""
        return self._errors

    @property
    def estimate(self) -> Floats:
        """(n,3) m, world: where each autopilot believes to be."""
        return self._shared.estimate.p

    @property
    def armed(self) -> NDArray[np.bool_]:
        """(n,) whether the motors may turn."""
        return np.array([u.commander.armed for u in self.units])

    @property
    def landed(self) -> NDArray[np.bool_]:
        """(n,) whether on the ground and at rest."""
        return np.array([u.commander.landed for u in self.units])

    @property
    def mode(self) -> list[Mode]:
        """The mode of each vehicle."""
        return [u.commander.mode for u in self.units]

    def advance(self, t_end: float, wind: ArrayLike = 0.0) -> None:
        """Simulate up to t_end [s], a multiple of 1 ms; wind: (3,) or (n,3) m/s, world."""
        mean = np.asarray(wind, dtype=np.float64)
        if mean.shape != self.vehicles.p.shape or not mean.flags.c_contiguous:
            mean = np.ascontiguousarray(np.broadcast_to(mean, self.vehicles.p.shape))
        end = round(t_end / SUBSTEP)
        while self._substeps < end:
            place = self._substeps % BLOCK_SUBSTEPS
            if place % TICK_SUBSTEPS == 0:
                self._surroundings.step(TICK_SUBSTEPS * SUBSTEP, mean)
                self._tick(place)
            gusts = self._surroundings.gusts
            air = mean if gusts is None else mean + gusts
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
        """Update sensors, batteries, modes and outer loops, every 10 ms."""
        ticks = self._substeps // TICK_SUBSTEPS
        if place == 0 and self._substeps > 0:
            self._estimator.next_block()
            self._errors.next_block()
        self._estimator.step_drifts(place // TICK_SUBSTEPS)
        self._errors.step(place // TICK_SUBSTEPS, self.vehicles.state, self._shared.estimate)
        self._observe()
        self._late.record(self._substeps * 1000)
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
        """Let vehicle i take a message now; return its replies for the same link.

        link: "companion" or "gcs"; None: by the component that sent the message.
        """
        unit = self.units[i]
        self._set_clock(unit)
        if link is None:
            own = (
                received.source.component == ComponentId.ONBOARD_COMPUTER
                or received.source.system == unit.system
            )
            link = "companion" if own else "gcs"
        return answer(unit, received, link)

    def sticks(self, i: int, channels: Sequence[float]) -> None:
        """Give a Betaflight vehicle its RC channels [µs], A E T R AUX1 …; every 20 ms."""
        unit = self.units[i]
        self._set_clock(unit)
        unit.commander.fly_sticks(channels)

    # Faults.

    def fail(self, i: int, sensor: str, failed: bool = True) -> None:
        """Let a sensor of vehicle i fail, or work again.

        Raises:
            ValueError: there is no such sensor; the message lists the choices.
        """
        if sensor not in SENSORS:
            raise ValueError(f"unknown sensor {sensor!r}: choose one of {', '.join(SENSORS)}")
        faults = self.units[i].commander.failed
        (faults.add if failed else faults.discard)(sensor)

    def shift_position(self, i: int, offset: ArrayLike) -> None:
        """Shift the position estimate of vehicle i by `offset` (3,) m, world."""
        self._errors.shift(i, offset)

    def bias_gyro(self, i: int, bias: ArrayLike) -> None:
        """Give the gyro of vehicle i a bias (3,) rad/s."""
        self._shared.estimate.bias[i] = bias

    def gyro_bias(self, i: int) -> Floats:
        """Return the gyro bias (3,) rad/s of vehicle i."""
        bias: Floats = self._shared.estimate.bias[i].copy()
        return bias

    def set_battery(self, i: int, remaining: float) -> None:
        """Set the remaining charge 0…1 of vehicle i."""
        self._shared.batteries.remaining[i] = remaining

    def fly_to(self, i: int, p: ArrayLike, speed: float) -> None:
        """Fly vehicle i straight to p (3,) m, world, at `speed` [m/s], and hold there."""
        self.units[i].commander.set_mode(Mode.HOLD)
        setpoints = self._shared.setpoints
        setpoints.p[i] = p
        setpoints.limits[i, 0] = speed

    def fly_with(self, i: int, v: ArrayLike) -> None:
        """Fly vehicle i with the velocity v (3,) m/s, world, as long as it is in HOLD."""
        setpoints = self._shared.setpoints
        setpoints.p[i] = np.nan
        setpoints.v[i] = v
        setpoints.limits[i] = np.linalg.norm(setpoints.v[i])  # as fast as asked, in any direction

    def take_off(self, i: int, height: float) -> None:
        """Arm vehicle i and let it climb by `height` [m], each in its autopilot's way."""
        unit = self.units[i]
        if not unit.flavour.takeoff_mode:
            unit.commander.set_mode(Mode.OFFBOARD)
        unit.commander.arm()
        unit.commander.take_off(height)

    def reboot(self, i: int) -> None:
        """Restart the autopilot of vehicle i: clock 0, disarmed, parameters and mission reset."""
        self._shared.setpoints.control[i] = Control.OFF
        self.units[i] = self._boot(i, self.units[i].system, -self.t)

    def telemetry(self, i: int, link: str, quiet: bool = False) -> list[Message]:
        """Return the messages of vehicle i that are due now on link "companion" or "gcs".

        quiet: HEARTBEAT alone, as long as nothing was received on the link.
        """
        unit = self.units[i]
        self._set_clock(unit)
        return unit.telemetry(link, quiet)

    def _set_clock(self, unit: Unit) -> None:
        unit.now_us = self._substeps * 1000
        unit.commander.now = unit.guidance.now = self.t
