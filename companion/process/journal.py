"""Log lines for the journal: `<priority>event key=value …`, at a bounded rate.

systemd reads the priority from the prefix of each line; on a terminal it is left out.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable

_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3}
_BURST, _SPAN = 5, 10.0  # lines of one event in so many seconds
log = logging.getLogger("companion")


def set_up() -> None:
    """Send `log` to stderr; once in a process."""
    if log.handlers:
        return
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Fields(prefix=_stderr_is_journal()))
    handler.addFilter(RateLimit(time.monotonic))
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    log.propagate = False


def event(name: str, /, level: int = logging.INFO, **fields: object) -> None:
    """Log an event; the rate limit counts by `name`."""
    log.log(level, name, extra={"fields": fields})


class Fields(logging.Formatter):
    """Formats `event key=value …`; values with spaces are quoted, line breaks escaped."""

    def __init__(self, prefix: bool) -> None:
        super().__init__()
        self._prefix = prefix

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line."""
        fields = getattr(record, "fields", {})
        text = " ".join([record.getMessage(), *(f"{k}={_quoted(v)}" for k, v in fields.items())])
        return f"<{_PRIORITY.get(record.levelno, 6)}>{text}" if self._prefix else text


class RateLimit(logging.Filter):
    """Passes a few lines of each event, and counts the others into the next that passes."""

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock = clock
        self._passed: dict[str, list[float]] = {}
        self._dropped: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether this event has not yet had its share of the last seconds."""
        now, key = self._clock(), record.msg
        recent = [t for t in self._passed.get(key, []) if now - t < _SPAN]
        self._passed[key] = recent
        if len(recent) >= _BURST:
            self._dropped[key] = self._dropped.get(key, 0) + 1
            return False
        recent.append(now)
        if dropped := self._dropped.pop(key, 0):
            record.fields = {**getattr(record, "fields", {}), "suppressed": dropped}
        return True


def _quoted(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = str(value).encode("unicode_escape").decode("ascii")
    return '"' + text.replace('"', "'") + '"' if not text or " " in text or "=" in text else text


def _stderr_is_journal() -> bool:
    """Return whether stderr is the stream whose device and inode JOURNAL_STREAM names.

    Source: systemd.exec(5).
    """
    status = os.fstat(sys.stderr.fileno())
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
