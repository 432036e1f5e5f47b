"""Real autopilots on the simulator's physics, in lockstep: a user's SITL binary for each vehicle.

`LockstepFleet` stands in for `Autopilots` in a flight. Each autopilot gets the motion of its
vehicle, and the physics goes on when its motor commands have come: simulated time advances with
the autopilots alone, however slow the machine is. Their MAVLink passes through the simulator,
unaltered, so that companions get it in step with their frames.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sitl_sim.external.external_sitl import ExternalError, ExternalSitl
from sitl_sim.external.readiness import Readiness
from sitl_sim.vehicles.rigid_body import Vehicles

_SUBSTEP = 0.001  # s
_LONGEST_STEP = 2  # substeps; at any such step something may happen in a flight
_STARTS = 60.0  # s (wall) for a process to connect and to answer its first step
_BOOT_ANSWER = 0.02  # s (wall); PX4 does not answer its first steps
_ANSWER = 20.0  # s (wall) after which a silent autopilot counts as dead
_LOCATED, _ARMABLE = 60.0, 90.0  # s (simulated) until it knows its place, and can be armed
_STREAM = 0.03  # s; an attitude that comes at least so often is a stream
_LATE = 0.1  # s (wall) that its next one is waited for
_ATTEMPTS = 3
_WHOLE = 100  # substeps: a flight begins at a multiple of a camera's period


class LockstepFleet:
    """n real autopilots; index i is the vehicle's.

    Raises:
        ExternalError: one line that says which autopilot lacks what.
    """

    def __init__(
        self,
        vehicles: Vehicles,
        program: Callable[[int], ExternalSitl],
        clock: Sequence[float],
    ) -> None:
        """Start all autopilots and let them boot on the ground, in simulated time.

        program: starts the autopilot of vehicle i. clock: what its clock shows at its start [s].
        """
        self.vehicles = vehicles
        self._program, self._clock = program, clock
        self._substeps = 0  # since the autopilots were started
        self._first = 0  # the substep at which the flight began
        self._sitls: list[ExternalSitl] = []
        self._said: list[Readiness] = []
        self._calm = np.zeros_like(vehicles.p)
        try:
            self._boot()
        except BaseException:
            self.close()
            raise
        self._first = self._substeps

    # --- boot ------------------------------------------------------------------------------

    def _boot(self) -> None:
        """Stand on the ground until each can be armed; without an estimate all start anew.

        An autopilot that knows its place and cannot be armed for another reason flies on: it
        tells that to its companion.
        """
        for _ in range(_ATTEMPTS):
            self.close()
            self._start()
            began = self._substeps
            while not self._booted((self._substeps - began) * _SUBSTEP):
                self._step(self._calm, _BOOT_ANSWER)
                self._listen()
            if all(said.located for said in self._said):
                break
        else:
            i = next(i for i, said in enumerate(self._said) if not said.located)
            raise ExternalError(self._lacks(i, f"does not know its place after {_LOCATED:g} s"))
        while self._substeps % _WHOLE:
            self._step(self._calm, _ANSWER)

    def _start(self) -> None:
        """Start the autopilots and step them at real time until each is heard on MAVLink.

        Their start scripts take the machine's time, not the simulated one.
        """
        self._substeps, self._said = (
            4,
            [Readiness(i + 1) for i in range(len(self.vehicles))],
        )
        for i in range(len(self.vehicles)):  # one by one: `close` ends those that run
            self._sitls.append(self._program(i))
        end = time.monotonic() + _STARTS
        while not all(s.links["gcs"].heard for s in self._sitls):
            following = time.monotonic() + _LONGEST_STEP * _SUBSTEP
            for i, sitl in enumerate(self._sitls):
                if not sitl.alive:
                    raise ExternalError(self._lacks(i, "ended"))
                if time.monotonic() > end and not sitl.links["gcs"].heard:
                    raise ExternalError(self._lacks(i, "sends nothing"))
            if all(s.connected for s in self._sitls):
                self._step(self._calm, _BOOT_ANSWER)
            self._listen()
            time.sleep(max(following - time.monotonic(), 0.0))

    def _booted(self, waited: float) -> bool:
        """Return whether all can be armed, or have had the time [s] to become so."""
        if not all(said.located for said in self._said):
            return waited > _LOCATED
        return all(said.armable for said in self._said) or waited > _ARMABLE

    def _listen(self) -> None:
        """Read what the autopilots say while nobody else listens."""
        for sitl, said in zip(self._sitls, self._said, strict=True):
            sitl.links["companion"].receive()
            link = sitl.links["gcs"]
            for packet in link.receive():
                said.hear(packet)
            said.ask(self._substeps * _SUBSTEP, link)

    def _lacks(self, i: int, what: str) -> str:
        sitl, words = self._sitls[i], ""
        if i < len(self._said) and self._said[i].words:
            words = f" ({'; '.join(self._said[i].words)})"
        return f"{sitl.name} of vehicle {i + 1} {what}{words}; see {sitl.folder}/output.log"

    # --- as `Autopilots` -------------------------------------------------------------------

    @property
    def t(self) -> float:
        """Seconds since the flight began."""
        return (self._substeps - self._first) * _SUBSTEP

    @property
    def armed(self) -> NDArray[np.bool_]:
        """(n,) whether the HEARTBEAT said so."""
        return np.array([said.armed for said in self._said])

    @property
    def clock_ms(self) -> list[int]:
        """What each autopilot's clock shows now [ms]."""
        return [round((c + self._substeps * _SUBSTEP) * 1e3) for c in self._clock]

    def advance(self, t_end: float, wind: ArrayLike = 0.0) -> None:
        """Fly until t_end [s], a multiple of 2 ms; wind: (3,) or (n,3) m/s, world.

        Raises:
            ExternalError: an autopilot ended, or answers no more.
        """
        air = np.ascontiguousarray(
            np.broadcast_to(np.asarray(wind, dtype=np.float64), self.vehicles.p.shape)
        )
        end = self._first + round(t_end / _SUBSTEP)
        while self._substeps < end:
            if late := self._step(air, _ANSWER):
                what = "does not answer" if self._sitls[late[0]].alive else "ended"
                raise ExternalError(self._lacks(late[0], what))
        self.vehicles.t = self.t

    def _step(self, wind: NDArray[np.float64], patience: float) -> list[int]:
        """Advance 1 or 2 ms; return the vehicles whose autopilot did not answer in `patience` [s].

        An autopilot's motor commands hold until its next step.
        """
        now, state = self._substeps * _SUBSTEP, self.vehicles.state
        periods = [round(s.period / _SUBSTEP) for s in self._sitls]
        due = [i for i, period in enumerate(periods) if self._substeps % period == 0]
        for i in due:
            self._sitls[i].send(now, i, state)
        late = [i for i in due if not self._sitls[i].receive(patience)]
        commands = np.array([s.command for s in self._sitls])
        steps = min(*periods, _LONGEST_STEP)
        self.vehicles.step(steps * _SUBSTEP, commands, wind, steps)
        self._substeps += steps
        return late

    def packets(self, i: int, link: str) -> list[bytes]:
        """Return what the autopilot of vehicle i sent on `link`, companion or gcs, since last.

        A thread of PX4's own sends it, behind the motor commands: where its attitude is streamed,
        the newest one is waited for, so that telemetry is not late on a busy machine.
        """
        source, said = self._sitls[i].links[link], self._said[i]
        packets = source.receive()
        if link == "gcs":
            return packets
        now = self._clock[i] + self._substeps * _SUBSTEP
        end = time.monotonic() + _LATE * (said.gap < _STREAM)
        heard = 0
        while True:
            for packet in packets[heard:]:
                said.hear(packet)
            heard = len(packets)
            left = end - time.monotonic()
            if left <= 0.0 or said.stamp > now - _STREAM:
                return packets
            source.wait(left)
            packets += source.receive()

    def pass_on(self, i: int, link: str, packet: bytes) -> None:
        """Give the autopilot of vehicle i a packet that came on `link`."""
        self._sitls[i].links[link].send(packet)

    def close(self) -> None:
        """End the autopilots: all of them, also where a second signal interrupts that."""
        with ExitStack() as stack:
            while self._sitls:
                stack.callback(self._sitls.pop().close)
