"""When each telemetry message of one link falls due."""

from __future__ import annotations

SLACK_US = 100  # a message is due when the clock is this close: floats are not exact


class Schedule:
    """Due times of the messages of one link, on the vehicle's own clock [µs].

    A message with period T falls due at the multiples of T, so messages of one rate stay together.
    """

    def __init__(self, rates_hz: dict[int, float]) -> None:
        self._period: dict[int, int] = {}
        self._next: dict[int, int] = {}
        self._earliest = 0
        for message_id, rate_hz in rates_hz.items():
            self.set_rate(message_id, rate_hz)

    def set_rate(self, message_id: int, rate_hz: float) -> None:
        """Send a message at this rate [Hz] from now on; 0 stops it."""
        self._period.pop(message_id, None)
        self._next.pop(message_id, None)
        if rate_hz > 0.0:
            self._period[message_id] = max(round(1e6 / rate_hz), 2000)
            self._next[message_id] = 0
        self._earliest = 0

    def rate(self, message_id: int) -> float:
        """Return the rate of a message [Hz]; 0 where stopped."""
        period = self._period.get(message_id)
        return 1e6 / period if period else 0.0

    def due(self, now_us: int) -> list[int]:
        """Return the message ids due now; each at most once, however late the call."""
        now_us += SLACK_US
        if now_us < self._earliest:
            return []
        ids = [m for m, at in self._next.items() if at <= now_us]
        for m in ids:
            self._next[m] = (now_us // self._period[m] + 1) * self._period[m]
        self._earliest = min(self._next.values(), default=1 << 62)
        return ids
