"""Link quality: the share of the vehicle's telemetry that is lost on the way.

Setpoints take the same way back: where telemetry is lost, setpoints are lost too, and each is in
force for longer than meant. The share is known only after a second in which next to nothing was
lost: some routers mix the sequence numbers of several streams, which then say nothing.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from mavlink_bridge.wire.messages import Heartbeat, Received

_WINDOW = 1.0  # s
_FRAMES_MIN = 20  # frames in the window; fewer say nothing
_TRUSTED_LOSS = 0.05  # share missing in some window below which sequence numbers are trusted


class LinkQuality:
    """Counts the autopilot's frames of the last second, and the missing ones."""

    def __init__(self, silence: float) -> None:
        """silence: s without a frame after which the mode last told is not known any more.

        A pilot may have taken the vehicle meanwhile.
        """
        self.knows_mode = False  # whether a heartbeat came since the last silence
        self._silence = silence
        self._last = math.inf
        self._counts: deque[tuple[float, int, int]] = deque()  # (time, received, missing)
        self._trusted = False

    @property
    def lost(self) -> float:
        """Share 0…1 of the frames of the last second that did not come; 0 where unknown."""
        return self._share() if self._trusted else 0.0

    def hear(self, time: float, received: Iterable[Received]) -> None:
        """Count the autopilot's frames since the last tick; `time` [s]: of this tick."""
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
        self._trusted |= self._came() >= _FRAMES_MIN and self._share() < _TRUSTED_LOSS

    def _came(self) -> int:
        """Return the number of frames that came in the window."""
        return sum(came for _, came, _ in self._counts)

    def _share(self) -> float:
        """Return the share of missing frames in the window; 0 where too few came."""
        came, missing = self._came(), max(sum(m for _, _, m in self._counts), 0)
        return missing / (came + missing) if came + missing >= _FRAMES_MIN else 0.0
