"""What is logged while a drone waits on the ground: one tick in a hundred, and all around a change.

A daemon may wait for weeks on a board with a small disk. The newest ticks are held back, so that
the seconds before the vehicle arms are whole in the log.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable
from typing import Generic, TypeVar

from companion.tick import Tick
from companion.types import Phase
from mavlink_bridge.shared.arrays import norm

_AROUND = 100  # ticks before a change, and as many after it, that are logged in full
_ONE_IN = 100  # ticks of those that are older
_KNOWN = 6000  # ticks for which a situation that comes back is no news: ten minutes
_SITUATIONS = 64  # most situations that are known
_WAITING = {Phase.WAIT, Phase.DONE, Phase.PASSIVE}
_STANDS = 0.5  # m/s, faster than which a disarmed vehicle is carried, or falls
_DIGITS = re.compile(r"[-+\d.]+")

Entry = TypeVar("Entry")


class IdleTicks(Generic[Entry]):
    """Holds back the newest ticks while nothing happens, and passes few of those that grow old."""

    def __init__(self) -> None:
        self._held: deque[list[Entry]] = deque()
        self._situations: dict[tuple[object, ...], int] = {}  # tick at which each was news
        self._situation: tuple[object, ...] = ()
        self._tick = 0
        self._awake = 0  # ticks that are still logged in full
        self._old = 0

    @property
    def asleep(self) -> bool:
        """Whether the newest tick is held back."""
        return bool(self._held)

    def due(self, tick: Tick, entries: list[Entry]) -> Iterable[Entry]:
        """Return what is to be written now, oldest first; entries: what this tick would write."""
        if self._news(_situation(tick)) or not _idle(tick):
            self._awake = _AROUND
        self._held.append(entries)
        if self._awake:
            self._awake -= 1
            return self.rest()
        if len(self._held) <= _AROUND:
            return []
        oldest, self._old = self._held.popleft(), (self._old + 1) % _ONE_IN
        return oldest if self._old == 0 else []

    def _news(self, situation: tuple[object, ...]) -> bool:
        """Return whether a situation begins that has not begun lately: faults come and go."""
        self._tick += 1
        if situation == self._situation:
            return False
        self._situation = situation
        known = self._situations.pop(situation, None)
        if known is not None and self._tick - known < _KNOWN:
            self._situations[situation] = known
            return False
        self._situations[situation] = self._tick
        if len(self._situations) > _SITUATIONS:
            del self._situations[next(iter(self._situations))]
        return True

    def rest(self) -> Iterable[Entry]:
        """Return everything that is held back; it is forgotten here."""
        held = [entry for entries in self._held for entry in entries]
        self._held.clear()
        return held


def _idle(tick: Tick) -> bool:
    """Return whether the vehicle stands disarmed, and refuses nothing."""
    vehicle, supervised = tick.vehicle, tick.supervised
    if vehicle.heartbeat is not None and vehicle.heartbeat.armed:
        return False
    moves = vehicle.state is not None and not norm(vehicle.state.v) < _STANDS
    busy = moves or supervised.verdict is not None or vehicle.refusals
    return supervised.phase in _WAITING and not busy


def _situation(tick: Tick) -> tuple[object, ...]:
    """Return what a change of is worth the ticks around it; the numbers in a reason are not."""
    supervised, heartbeat = tick.supervised, tick.vehicle.heartbeat
    return (
        supervised.phase,
        _DIGITS.sub("", supervised.inhibit_reason),
        heartbeat and (heartbeat.armed, heartbeat.custom_mode),
        tick.seen.fault,
        _DIGITS.sub("", tick.failure),
        tick.broken and _DIGITS.sub("", tick.broken.finding),
    )
