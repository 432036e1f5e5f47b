"""How much of what the vehicle says is lost on the way.

Commands go the same way: where telemetry is lost, they are, and each is in force for longer than
meant. Believed only where next to nothing was lost once: on some routers the numbers of several
streams mix, and say nothing.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from mavlink_bridge.wire.messages import Heartbeat, Received

_WINDOW = 1.0  # s
_LEAST = 20  # frames; fewer say nothing
_SOUND = 0.05  # share that may be missing from a line whose numbers are believed


class LinkQuality:
    """The autopilot's frames of the last second.

    silence: s without any after which the mode that it last told of is not known any more: a pilot
    may have taken the vehicle meanwhile. knows_mode: whether a heartbeat has come since.
    """

    def __init__(self, silence: float) -> None:
        self.knows_mode = False
        self._silence = silence
        self._last = math.inf
        self._counts: deque[tuple[float, int, int]] = deque()  # (time, came, missing)
        self._sound = False

    @property
    def lost(self) -> float:
        """Share 0…1 of the frames of the last second that did not come; 0 where unknown."""
        return self._share() if self._sound else 0.0

    def hear(self, time: float, received: Iterable[Received]) -> None:
        """What came of the autopilot since the last tick; `time` [s] of this one."""
        came = missing = 0
        self.knows_mode &= time - self._last <= self._silence
        for r in received:
            came += 1 + r.unread
            missing += r.missing
            self.knows_mode |= isinstance(r.message, Heartbeat)
            self._last = time
        self._counts.append((time, came, missing))
        while self._counts[0][0] <= time - _WINDOW:
            self._counts.popleft()
        self._sound |= self._came() >= _LEAST and self._share() < _SOUND

    def _came(self) -> int:
        return sum(came for _, came, _ in self._counts)

    def _share(self) -> float:
        came, missing = self._came(), max(sum(m for _, _, m in self._counts), 0)
        return missing / (came + missing) if came + missing >= _LEAST else 0.0
