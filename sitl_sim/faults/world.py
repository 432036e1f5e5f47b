"""Faults of vehicles, autopilots, pilots, companions and the air."""

from __future__ import annotations

import resource
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sitl_sim.faults.catalogue import Fault, Schedule
from sitl_sim.vehicles.firmware.flavour import Mode

if TYPE_CHECKING:
    from sitl_sim.vehicles.emulated import Autopilots
    from sitl_sim.vehicles.rigid_body import Vehicles

_MODES = {
    "hold": Mode.HOLD,
    "land": Mode.LAND,
    "return": Mode.RETURN,
    "position": Mode.POSITION,
    "stabilized": Mode.STABILIZED,
}
_THROUGH = 30.0  # m; a vehicle that turns into its neighbour aims this far away


class FaultyWorld:
    """Applies each fault to its vehicle when it begins, and removes it when it ends.

    autopilots: the emulated ones, None for real ones. process: process id of drone i's companion,
    or None. rebooted: called with the index of a drone whose autopilot restarts. wind: (3,) m/s,
    world, its mean.
    """

    def __init__(
        self,
        schedule: Schedule,
        vehicles: Vehicles,
        autopilots: Autopilots | None,
        process: Callable[[int], int | None] = lambda i: None,
        rebooted: Callable[[int], None] = lambda i: None,
        wind: ArrayLike = 0.0,
    ) -> None:
        self._schedule, self._vehicles, self._autopilots = schedule, vehicles, autopilots
        self._process, self._rebooted = process, rebooted
        self._on: dict[int, Fault] = {}  # by id, in the order in which they began
        self._whole = vehicles.body.thrust_max.copy()
        self._own_bias = [
            autopilots.gyro_bias(i) if autopilots else np.zeros(3) for i in range(len(vehicles))
        ]
        self._limits: dict[int, tuple[int, int]] = {}  # process id → its original limits
        self._mean_wind = np.empty((len(vehicles), 3))
        self._mean_wind[:] = wind
        self._gusts = [f for f in schedule.all() if f.kind == "gust"]
        self._motors = {id(f): _motors(f) for f in schedule.all()}
        self._ways = {
            id(f): _towards_any_side(f)
            for f in schedule.all()
            if f.kind in ("gust", "velocity_slide")
        }
        # Faults may overlap: whenever one begins or ends, the effect of its kind on vehicle i is
        # computed from the vehicle without faults and all faults that are present.
        self._lasting: dict[str, Callable[[int], None]] = {
            "motor": self._set_thrust,
            "thrust_scale": self._set_thrust,
            "gyro_bias": self._set_bias,
            "position_lost": self._set_gps,
            "position_jump": self._set_offset,
            "rtk_float": self._set_float,
            "compass": self._set_compass,
            "height_drift": self._set_height_drift,
            "velocity_slide": self._set_slide,
            "disk_full": self._set_disk,
        }
        self._sudden: dict[str, Callable[[Fault], None]] = {
            "battery": self._drain,
            "position_reset": self._reset_position,
            "reboot": self._reboot,
            "stop": self._stop,
            "turn_into": self._turn_into,
            "kill": self._kill,
            "mode": self._change_mode,
        }

    def update(self, now: float) -> None:
        """Apply what begins and remove what ends at `now` [s of the flight], which only grows."""
        for fault in self._schedule.all():
            key, active = id(fault), fault.config.active(now)
            if active and fault.kind == "disarm" and self._autopilots is not None:
                self._autopilots.units[fault.i].commander.disarm()
            if active == (key in self._on):
                continue
            if active:
                self._on[key] = fault
            else:
                del self._on[key]
            if fault.kind in self._lasting:
                self._lasting[fault.kind](fault.i)
            elif active and fault.kind in self._sudden:
                self._sudden[fault.kind](fault)

    def wind(self, now: float) -> NDArray[np.float64]:
        """Return the wind (n,3) m/s, world: its mean and the gusts of each drone."""
        if not self._gusts:
            return self._mean_wind
        air = self._mean_wind.copy()
        for fault in self._gusts:
            if fault.config.active(now):
                air[fault.i] += self._ways[id(fault)]
        return air

    def _emulated(self) -> Autopilots:
        assert self._autopilots is not None  # `catalogue.check` refuses other flights
        return self._autopilots

    def _of(self, i: int, *kinds: str) -> list[Fault]:
        """Return vehicle i's faults of these kinds that are present."""
        return [f for f in self._on.values() if f.i == i and f.kind in kinds]

    def _set_thrust(self, i: int) -> None:
        """Set the motors from whole ones: a factor of 0 could not be divided out again."""
        row = self._vehicles.body.thrust_max[i]
        row[:] = self._whole[i]
        for f in self._of(i, "motor", "thrust_scale"):
            row[self._motors[id(f)]] *= f.value

    def _set_bias(self, i: int) -> None:
        more = sum(f.value for f in self._of(i, "gyro_bias"))
        self._emulated().bias_gyro(i, self._own_bias[i] + more)

    def _set_gps(self, i: int) -> None:
        self._emulated().fail(i, "gps", failed=bool(self._of(i, "position_lost")))

    def _set_offset(self, i: int) -> None:
        east = sum(f.value for f in self._of(i, "position_jump"))
        self._emulated().shift_position(i, [east, 0.0, 0.0])

    def _set_float(self, i: int) -> None:
        self._emulated().errors.float_solution(i, sum(f.value for f in self._of(i, "rtk_float")))

    def _set_compass(self, i: int) -> None:
        angle = sum(f.value for f in self._of(i, "compass"))
        self._emulated().errors.turn_compass(i, np.radians(angle))

    def _set_height_drift(self, i: int) -> None:
        rate = sum(f.value for f in self._of(i, "height_drift"))
        self._emulated().errors.drift_height(i, rate / 60.0)

    def _set_slide(self, i: int) -> None:
        ways = [self._ways[id(f)] for f in self._of(i, "velocity_slide")]
        self._emulated().errors.slide(i, np.sum(ways, axis=0) if ways else np.zeros(3))

    def _reset_position(self, f: Fault) -> None:
        self._emulated().errors.reset(f.i, _towards_any_side(f))

    def _set_disk(self, i: int) -> None:
        """Keep the companion's files from growing: writing fails as on a full disk."""
        pid = self._process(i)
        if pid is None:
            return
        try:
            before = self._limits.setdefault(pid, resource.prlimit(pid, resource.RLIMIT_FSIZE))
            full = (0, before[1])
            limits = full if self._of(i, "disk_full") else before
            resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
        except ProcessLookupError:
            return  # it has ended

    def _drain(self, f: Fault) -> None:
        self._emulated().set_battery(f.i, f.value)

    def _reboot(self, f: Fault) -> None:
        self._emulated().reboot(f.i)
        self._set_gps(f.i)  # a restart repairs no sensor
        self._rebooted(f.i)

    def _stop(self, f: Fault) -> None:
        self._emulated().units[f.i].commander.set_mode(Mode.HOLD)

    def _change_mode(self, f: Fault) -> None:
        assert f.config.to is not None
        self._emulated().units[f.i].commander.set_mode(_MODES[f.config.to])

    def _kill(self, f: Fault) -> None:
        self._emulated().units[f.i].commander.disarm(force=True)

    def _turn_into(self, f: Fault) -> None:
        """Fly the vehicle straight through the present place of its nearest neighbour."""
        p = self._vehicles.p
        away = np.linalg.norm(p - p[f.i], axis=1)
        away[f.i] = np.inf
        towards = p[int(np.argmin(away))] - p[f.i] if len(p) > 1 else np.array([1.0, 0.0, 0.0])
        aim = p[f.i] + towards / np.linalg.norm(towards) * _THROUGH
        self._emulated().fly_to(f.i, aim, f.value)


def _motors(f: Fault) -> slice:
    """Return the motors that a fault weakens."""
    return slice(int(f.rng.integers(4)), None, 4) if f.kind == "motor" else slice(None)


def _towards_any_side(f: Fault) -> NDArray[np.float64]:
    """Return the fault's amount as a vector (3,) along the ground in a random direction."""
    angle = f.rng.uniform(0.0, 2.0 * np.pi)
    return f.value * np.array([np.cos(angle), np.sin(angle), 0.0])
