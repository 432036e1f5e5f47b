"""One writer at a time in a folder; the kernel releases the lock when the process ends."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_LOCK = ".lock"


class FolderInUseError(Exception):
    """Another flight or campaign writes into the folder."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Create the folder where it is missing, and hold its lock.

    Raises:
        FolderInUseError: another writer holds the lock.
        OSError: the folder cannot be created.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK).open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise FolderInUseError(f"{folder}: another flight is written into it") from None
        yield
