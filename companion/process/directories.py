"""Places where a daemon may write: the directories that systemd made for it, or here."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path


def log_path(pattern: str, environment: Mapping[str, str], now: datetime | None = None) -> Path:
    """Return the flight log's file: `{time}` in UTC, relative paths in the log directory."""
    stamp = (now or datetime.now(UTC)).strftime("%Y%m%dT%H%M%SZ")
    folder = environment.get("LOGS_DIRECTORY", "").split(":")[0]
    return Path(folder) / pattern.replace("{time}", stamp)


class StateFile:
    """The daemon's present state in a file, for the installer, which leaves armed drones alone.

    The file lies in the run directory and is written when something changes; without systemd there
    is none.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        folder = environment.get("RUNTIME_DIRECTORY", "").split(":")[0]
        self._path = Path(folder) / "state.json" if folder else None
        self._last: dict[str, object] = {}

    def write(self, **state: object) -> bool:
        """Write the present state; return whether it is new. An error never ends the flight."""
        if state == self._last:
            return False
        self._last = dict(state)
        if self._path is not None:
            self._replace(self._path)
        return True

    def _replace(self, path: Path) -> None:
        text = json.dumps({"pid": os.getpid(), **self._last})
        part = path.with_suffix(".part")
        try:
            part.write_text(text)
            part.replace(path)
        except OSError:
            self._path = None


class ControlMark:
    """A file that is there while setpoints stream: where it is left, a daemon was cut off.

    It lies in the state directory, which outlives a restart of the board; without systemd there is
    none.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        folder = environment.get("STATE_DIRECTORY", "").split(":")[0]
        self._path = Path(folder) / "in-control" if folder else None
        self.left_behind = self._path is not None and self._path.exists()
        self._streaming = False

    def note(self, streaming: bool) -> None:
        """Note whether setpoints stream; an error never ends the flight."""
        if streaming is not self._streaming:
            self._streaming = streaming
            self._write() if streaming else self.clear()

    def clear(self) -> None:
        """Take the mark away: nobody was cut off."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink(missing_ok=True)

    def _write(self) -> None:
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.touch()
