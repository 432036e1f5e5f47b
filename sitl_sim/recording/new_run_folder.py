"""A folder for a new flight: no flight overwrites or deletes an earlier one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.recording.folder_lock import FolderInUseError, folder_lock
from sitl_sim.recording.run_folder import holds_flight


@contextmanager
def new_run_folder(asked: Path | None, default: Path) -> Iterator[Path]:
    """Yield a locked folder without a flight: `asked`, or the first of `default`, -2, -3 and so on.

    Raises:
        SettingsError: `asked` holds a flight or is being written, or no folder can be created.
    """
    with ExitStack() as lock:
        if asked is None:
            yield next(folder for folder in _numbered(default) if _taken(folder, lock) is None)
        elif why := _taken(asked, lock):
            raise SettingsError([f"--out {asked}: {why}; name another folder"])
        else:
            yield asked


def _numbered(default: Path) -> Iterator[Path]:
    yield default
    for number in itertools.count(2):
        yield default.with_name(f"{default.name}-{number}")


def _taken(folder: Path, lock: ExitStack) -> str | None:
    """Return why the folder cannot be used; None where it is now locked until `lock` is closed."""
    if holds_flight(folder):
        return "holds a flight"
    with ExitStack() as attempt:
        try:
            attempt.enter_context(folder_lock(folder))
        except FolderInUseError:
            return "another flight is written into it"
        except OSError as error:
            raise SettingsError([f"{folder}: no run folder: {error.strerror}"]) from error
        if holds_flight(folder):  # finished just now
            return "holds a flight"
        lock.push(attempt.pop_all())
    return None
