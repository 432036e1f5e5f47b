"""Faults of vehicles, autopilots, pilots, companions and the air, laid on and taken off in time."""

from __future__ import annotations

import resource
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sitl_sim.faults import Fault, Schedule
from sitl_sim.firmware.flavour import Mode

if TYPE_CHECKING:
    from sitl_sim.autopilot import Autopilots
    from sitl_sim.vehicle import Vehicles

_MODES = {"hold": Mode.HOLD, "land": Mode.LAND, "return": Mode.RETURN,
          "position": Mode.POSITION, "stabilized": Mode.STABILIZED}  # fmt: skip
_THROUGH = 30.0  # m beyond the neighbour that a vehicle which turns into it aims at


class FaultyWorld:
    """Lays each fault on its vehicle when it begins and takes it off when it ends.

    autopilots: emulated ones, or None where only the physics are ours. process: the companion
    of drone i, its process id or None. rebooted: told whose autopilot starts anew.
    """

    def __init__(
        self,
        schedule: Schedule,
        vehicles: Vehicles,
        autopilots: Autopilots | None,
        process: Callable[[int], int | None] = lambda i: None,
        rebooted: Callable[[int], None] = lambda i: None,
    ) -> None:
        self._schedule, self._vehicles, self._autopilots = schedule, vehicles, autopilots
        self._process, self._rebooted = process, rebooted
        self._on: dict[int, Callable[[], None]] = {}  # id of a fault → what takes it off
        self._over: set[int] = set()
        self._whole = vehicles.body.thrust_max.copy()
        self._weak: dict[int, tuple[int, slice, float]] = {}  # id of a fault → whose, which, how
        self._winds = {id(f): _wind(f) for f in schedule.all() if f.kind == "gust"}
        self._start: dict[str, Callable[[Fault], Callable[[], None] | None]] = {
            "motor": self._weaken, "thrust_scale": self._weaken, "gyro_bias": self._bias,
            "position_lost": self._lose_position, "position_jump": self._jump,
            "battery": self._drain, "reboot": self._reboot, "stop": self._stop,
            "turn_into": self._turn_into, "kill": self._kill, "mode": self._change_mode,
            "disk_full": self._fill_disk,
        }  # fmt: skip

    def update(self, now: float) -> None:
        """Everything that begins or ends at `now` [s of the flight]."""
        for fault in self._schedule.all():
            key, active = id(fault), fault.config.active(now)
            if active and fault.kind == "disarm" and self._autopilots is not None:
                self._autopilots.units[fault.i].commander.disarm()
            if fault.kind not in self._start:
                continue
            if active and key not in self._on and key not in self._over:
                self._on[key] = self._start[fault.kind](fault) or _nothing
            elif not active and key in self._on:
                self._on.pop(key)()
                self._over.add(key)

    def wind(self, now: float, base: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,3) m/s, world: `base` (3,) and the gusts of each drone."""
        air = np.tile(base, (len(self._vehicles), 1))
        for fault in self._schedule.all():
            if fault.kind == "gust" and fault.config.active(now):
                air[fault.i] += self._winds[id(fault)]
        return air

    def _emulated(self) -> Autopilots:
        assert self._autopilots is not None  # `faults.check` has seen to it
        return self._autopilots

    def _weaken(self, f: Fault) -> Callable[[], None]:
        motors = slice(None) if f.kind == "thrust_scale" else slice(f.rng.integers(4), None, 4)
        self._weak[id(f)] = f.i, motors, f.value
        self._set_thrust(f.i)

        def restore() -> None:
            del self._weak[id(f)]
            self._set_thrust(f.i)

        return restore

    def _set_thrust(self, i: int) -> None:
        """From whole motors and what weakens them now: a factor of 0 cannot be divided out."""
        row = self._vehicles.body.thrust_max[i]
        row[:] = self._whole[i]
        for whose, motors, factor in self._weak.values():
            if whose == i:
                row[motors] *= factor

    def _bias(self, f: Fault) -> Callable[[], None]:
        before = self._emulated().gyro_bias(f.i)
        self._emulated().bias_gyro(f.i, before + f.value)
        return lambda: self._emulated().bias_gyro(f.i, before)

    def _lose_position(self, f: Fault) -> Callable[[], None]:
        self._emulated().fail(f.i, "gps")
        return lambda: self._emulated().fail(f.i, "gps", failed=False)

    def _jump(self, f: Fault) -> Callable[[], None]:
        self._emulated().shift_position(f.i, [f.value, 0.0, 0.0])
        return lambda: self._emulated().shift_position(f.i, [0.0, 0.0, 0.0])

    def _drain(self, f: Fault) -> None:
        self._emulated().set_battery(f.i, f.value)

    def _reboot(self, f: Fault) -> None:
        self._emulated().reboot(f.i)
        self._rebooted(f.i)

    def _stop(self, f: Fault) -> None:
        self._emulated().units[f.i].commander.set_mode(Mode.HOLD)

    def _change_mode(self, f: Fault) -> None:
        assert f.config.to is not None
        self._emulated().units[f.i].commander.set_mode(_MODES[f.config.to])

    def _kill(self, f: Fault) -> None:
        self._emulated().units[f.i].commander.disarm(force=True)

    def _turn_into(self, f: Fault) -> None:
        """Straight through the place where the nearest neighbour is now, and on."""
        p = self._vehicles.p
        away = np.linalg.norm(p - p[f.i], axis=1)
        away[f.i] = np.inf
        towards = p[int(np.argmin(away))] - p[f.i] if len(p) > 1 else np.array([1.0, 0.0, 0.0])
        aim = p[f.i] + towards / np.linalg.norm(towards) * _THROUGH
        self._emulated().fly_to(f.i, aim, f.value)

    def _fill_disk(self, f: Fault) -> Callable[[], None] | None:
        """Its files may not grow: writing fails as on a full disk."""
        pid = self._process(f.i)
        if pid is None:
            return None
        before = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, before[1]))
        return lambda: _unlimit(pid, before)


def _unlimit(pid: int, limits: tuple[int, int]) -> None:
    try:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
    except ProcessLookupError:
        return  # it has ended


def _wind(f: Fault) -> NDArray[np.float64]:
    angle = f.rng.uniform(0.0, 2.0 * np.pi)
    return f.value * np.array([np.cos(angle), np.sin(angle), 0.0])


def _nothing() -> None:
    """What takes nothing off."""
