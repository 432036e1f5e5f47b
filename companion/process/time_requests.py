"""TIMESYNC: requests of the vehicle's time, and answers to the vehicle's own requests."""

from __future__ import annotations

import math
from collections import deque

from mavlink_bridge.wire.messages import Message, TimeSync

_PERIOD = 0.25  # s between requests
_LONGEST = 1.0  # s that an answer may take
_NANO = 1e-9


class TimeRequests:
    """Remembers the requests sent, so that no other answer counts. Times: CLOCK_MONOTONIC [s]."""

    def __init__(self) -> None:
        self._asked_at = -math.inf
        self._open: deque[int] = deque(maxlen=round(_LONGEST / _PERIOD))  # ns

    def due(self, now: float) -> list[Message]:
        """Return a request where one is due."""
        if now - self._asked_at < _PERIOD:
            return []
        self._asked_at = now
        self._open.append(round(now / _NANO))
        return [TimeSync(0, self._open[-1])]

    def reply(self, request: TimeSync, now: float) -> list[Message]:
        """Return the answer to a request of the vehicle; nothing to what is no request."""
        return [TimeSync(round(now / _NANO), request.ts1)] if request.tc1 == 0 else []

    def sent(self, answer: TimeSync, now: float) -> float | None:
        """Return when the request was sent that this answers; None: it answers none.

        A request is answered once, and within a second.
        """
        if answer.tc1 <= 0 or answer.ts1 not in self._open:
            return None
        self._open.remove(answer.ts1)
        sent = answer.ts1 * _NANO
        return sent if 0.0 <= now - sent <= _LONGEST else None
