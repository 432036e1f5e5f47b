"""Which frames of one MAVLink sender did not come, by the numbers 0…255 that each carries."""

from __future__ import annotations

from dataclasses import dataclass

_NUMBERS = 256
_BEHIND = 128  # a step as large as this is backwards: a frame was overtaken, or came twice


@dataclass
class FrameCount:
    """Counts since the last message that was taken.

    unknown: frames whose checksum nobody here can know; each explains one that seems to be missing.
    """

    missing: int = 0
    unread: int = 0
    unknown: int = 0
    _last: int | None = None

    def came(self, number: int, read: bool) -> None:
        """A sound frame with this number came; read: somebody here reads it."""
        step = 1 if self._last is None else (number - self._last) % _NUMBERS
        self.unread += not read
        if 0 < step < _BEHIND:
            explained = min(step - 1, self.unknown)
            self.missing += step - 1 - explained
            self.unread += explained
            self.unknown, self._last = 0, number
        elif step:
            self.missing -= 1  # it was counted as missing, and is there after all

    def taken(self) -> tuple[int, int]:
        """(missing, unread), which begin anew; missing < 0: some came after all."""
        counts = self.missing, self.unread
        self.missing = self.unread = 0
        return counts
