"""When a drone waits on the ground, so that few ticks are enough, and what ends that.

What a waiting daemon decides is that it goes on waiting. Once it has done so for a while, it ticks
once a second, and looks a few times as often at what came. A message that may change anything (the
vehicle is armed, its mode changes, a ground station asks) ends the rest: the ticks that follow come
every period, as in flight. The first of them is without that message, so that the tick which
decides on it does not seem late.
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.tick import Tick
from companion.types import Phase
from mavlink_bridge.shared.arrays import norm
from mavlink_bridge.wire.messages import (
    Heartbeat,
    Ping,
    Received,
    Source,
    SystemTime,
    TimeSync,
)

BETWEEN = 1.0  # s between two ticks at rest: as often as the companion's heartbeat goes out
# s between two looks: a look reads as much as a tick (`allowance.py`), which is three times what
# the busiest links bring in a tenth of a second; and a change is noticed no later.
_LOOKS = 0.2
_CALM_FOR = 5.0  # s of ticks that decide nothing, before the first rest and after each
_WAITING = {Phase.WAIT, Phase.DONE, Phase.PASSIVE}
_FRESH = 0.3  # s, age of telemetry
_STANDS, _TURNS = 0.3, 0.1  # m/s and rad/s, above which the drone is carried about
_ROUTINE = (Heartbeat, Ping, SystemTime, TimeSync)  # that any component sends by itself


class Rest:
    """Follows the ticks of one daemon, and says which may be left out.

    on: whether the drone rests.
    """

    def __init__(self, period: float, vehicle: Source, arms: bool) -> None:
        """period: s, of the ticks. vehicle: the autopilot. arms: the companion may arm by itself.

        One that does is never at rest before its flight: nobody announces it.
        """
        self.on = False
        self._vehicle = vehicle
        self._busy = {Phase.WAIT} if arms else set()
        self._calm, self._enough = 0, round(_CALM_FOR / period)
        self._resting_step = max(round(_LOOKS / period), 1)
        self._left_out, self._most = 0, round(BETWEEN / period / self._resting_step) - 1
        self._mode: tuple[bool, int, int] | None = None

    @property
    def step(self) -> int:
        """Periods from one tick, or one look, to the next."""
        return self._resting_step if self.on else 1

    def follow(self, tick: Tick) -> None:
        """Take in what a tick decided."""
        heartbeat = tick.vehicle.heartbeat
        self._mode = None if heartbeat is None else _mode(heartbeat)
        calm = self._is_calm(tick)
        self._calm = self._calm + 1 if calm else 0
        self.on = self._calm > self._enough or (self.on and calm)

    def may_leave_out(self) -> bool:
        """Return whether a look is enough now, in which no news came."""
        if not self.on or self._left_out >= self._most:
            self._left_out = 0
            return False
        self._left_out += 1
        return True

    def news(self, received: Sequence[Received]) -> bool:
        """Return whether any of these messages ends the rest."""
        return any(map(self._is_news, received))

    def end(self) -> None:
        """End the rest."""
        self.on, self._calm, self._left_out = False, 0, 0

    def _is_news(self, received: Received) -> bool:
        message = received.message
        if received.source != self._vehicle:
            return not isinstance(message, _ROUTINE)
        return isinstance(message, Heartbeat) and _mode(message) != self._mode

    def _is_calm(self, tick: Tick) -> bool:
        """Return whether the vehicle is heard, stands disarmed, and nothing is under way."""
        vehicle, supervised = tick.vehicle, tick.supervised
        own, heartbeat = vehicle.state, vehicle.heartbeat
        if own is None or heartbeat is None or heartbeat.armed:
            return False
        heard = vehicle.mode_known and vehicle.age < _FRESH and not vehicle.rebooted
        stands = norm(own.v) < _STANDS and norm(own.omega) < _TURNS
        waits = supervised.phase in _WAITING - self._busy and supervised.verdict is None
        return heard and stands and waits and not (vehicle.refusals or tick.failure)


def _mode(heartbeat: Heartbeat) -> tuple[bool, int, int]:
    return heartbeat.armed, heartbeat.custom_mode, heartbeat.system_status
