"""TIMESYNC: requests of the vehicle's time, and answers to the vehicle's own requests."""

from __future__ import annotations

import math
from collections import deque

from mavlink_bridge.wire.messages import Message, TimeSync

_PERIOD = 0.25  # s between requests
_LONGEST = 1.0  # s that an answer may take
# s that a request of the vehicle may wait here: PX4 uses no round trip of more than 10 ms, and
# writes a warning into its log for every few of them (src/lib/timesync/Timesync.hpp)
_LONGEST_WAIT = 0.008
_NANO = 1e-9


class TimeRequests:
    """Remembers the requests sent, so that no other answer counts. Times: CLOCK_MONOTONIC [s]."""

    def __init__(self) -> None:
        self._asked_at = -math.inf
        self._open: deque[int] = deque(maxlen=round(_LONGEST / _PERIOD))  # ns

    def due(self, now: float, period: float = _PERIOD) -> list[Message]:
        """Return a request where one is due; period: s between requests."""
        if now - self._asked_at < period:
            return []
        self._asked_at = now
        self._open.append(round(now / _NANO))
        return [TimeSync(0, self._open[-1])]

    def reply(self, request: TimeSync, now: float, waited: float = 0.0) -> list[Message]:
        """Return the answer to a request of the vehicle; nothing to what is no request.

        Nor to one that has waited here for too long [s]: no answer is better than a late one.
        """
        asks = request.tc1 == 0 and waited <= _LONGEST_WAIT
        return [TimeSync(round(now / _NANO), request.ts1)] if asks else []

    def sent(self, answer: TimeSync, now: float) -> float | None:
        """Return when the request was sent that this answers; None: it answers none.

        A request is answered once, and within a second.
        """
        if answer.tc1 <= 0 or answer.ts1 not in self._open:
            return None
        self._open.remove(answer.ts1)
        sent = answer.ts1 * _NANO
        return sent if 0.0 <= now - sent <= _LONGEST else None
