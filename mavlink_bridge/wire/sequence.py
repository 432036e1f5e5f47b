"""Lost frames of one MAVLink sender, from the sequence numbers 0…255 of its frames."""

from __future__ import annotations

from dataclasses import dataclass

_NUMBERS = 256
_BEHIND = 128  # a step as large as this is backwards: a frame late, or twice


@dataclass
class FrameCount:
    """Counts of frames since the last call of `take`.

    missing: gaps in the sequence numbers. unread: valid frames of a kind that this project does not
    use. unknown: frames whose checksum cannot be verified; each explains one gap.
    """

    missing: int = 0
    unread: int = 0
    unknown: int = 0
    _last: int | None = None

    def add(self, number: int, read: bool) -> None:
        """Count a valid frame with this sequence number; read: this project uses its kind."""
        step = 1 if self._last is None else (number - self._last) % _NUMBERS
        self.unread += not read
        if 0 < step < _BEHIND:
            explained = min(step - 1, self.unknown)
            self.missing += step - 1 - explained
            self.unread += explained
            self.unknown, self._last = 0, number
        elif step:
            self.missing -= 1  # it is late and was counted as missing

    def take(self) -> tuple[int, int]:
        """Return (missing, unread) and reset both; missing < 0: frames counted before were late."""
        counts = self.missing, self.unread
        self.missing = self.unread = 0
        return counts
