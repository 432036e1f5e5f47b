"""What is logged while a drone waits on the ground: a tick in ten seconds, and all around a change.

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

_TENTH = 0.1  # s, in which all that follows is counted: a daemon at rest ticks once a second
_AROUND = 100  # tenths before a change, and as many after it, that are logged in full
_ONE_IN = 100  # tenths of those that are older
_KNOWN = 6000  # tenths for which a situation that comes back is no news: ten minutes
_SITUATIONS = 64  # most situations that are known
_WAITING = {Phase.WAIT, Phase.DONE, Phase.PASSIVE}
_STANDS = 0.5  # m/s, faster than which a disarmed vehicle is carried, or falls
_DIGITS = re.compile(r"[-+\d.]+")

Entry = TypeVar("Entry")


class IdleTicks(Generic[Entry]):
    """Holds back the newest ticks while nothing happens, and passes few of those that grow old."""

    def __init__(self) -> None:
        self._held: deque[tuple[int, list[Entry]]] = deque()  # with the tenths before each tick
        self._length = 0  # tenths that are held
        self._situations: dict[tuple[object, ...], int] = {}  # tenth at which each was news
        self._situation: tuple[object, ...] = ()
        self._time, self._now = 0.0, 0
        self._awake = 0  # tenths that are still logged in full
        self._old = 0

    @property
    def asleep(self) -> bool:
        """Whether the newest tick is held back."""
        return bool(self._held)

    def due(self, tick: Tick, entries: list[Entry]) -> Iterable[Entry]:
        """Return what is to be written now, oldest first; entries: what this tick would write."""
        passed = min(max(round((tick.time - self._time) / _TENTH), 1), _AROUND)
        self._time, self._now = tick.time, self._now + passed
        if self._news(_situation(tick)) or not _idle(tick):
            self._awake = _AROUND
        self._held.append((passed, entries))
        self._length += passed
        if self._awake:
            self._awake = max(self._awake - passed, 0)
            return self.rest()
        return self._grown_old()

    def _grown_old(self) -> list[Entry]:
        """Forget ticks of longer ago than is held back; return the few that are to be written."""
        written: list[Entry] = []
        while self._length > _AROUND:
            passed, oldest = self._held.popleft()
            self._length -= passed
            self._old += passed
            if self._old >= _ONE_IN:
                self._old -= _ONE_IN
                written += oldest
        return written

    def _news(self, situation: tuple[object, ...]) -> bool:
        """Return whether a situation begins that has not begun lately: faults come and go."""
        if situation == self._situation:
            return False
        self._situation = situation
        known = self._situations.pop(situation, None)
        if known is not None and self._now - known < _KNOWN:
            self._situations[situation] = known
            return False
        self._situations[situation] = self._now
        if len(self._situations) > _SITUATIONS:
            del self._situations[next(iter(self._situations))]
        return True

    def rest(self) -> Iterable[Entry]:
        """Return everything that is held back; it is forgotten here."""
        held = [entry for _, entries in self._held for entry in entries]
        self._held.clear()
        self._length = 0
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
