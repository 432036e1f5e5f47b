"""Blocks of ports, so that no two flights on this machine use the same port."""

from __future__ import annotations

import contextlib
import fcntl
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mavlink_bridge.shared.settings import SettingsError

_FIRST, _LAST = 16000, 24000  # below the kernel's own choice, away from the fixed ports
_UNIT = 8  # ports under one lock: equal for all, so that flights of any size exclude each other


def overrides(base: int, drones: int) -> list[str]:
    """Return `wire` settings that put a flight of `drones` into the block that begins at `base`."""
    return [
        f"wire.companion_port={base}",
        f"wire.frame_port={base + drones}",
        f"wire.gcs_port={base + 2 * drones + 1}",
    ]


@contextmanager
def block(drones: int, first: int = _FIRST, last: int = _LAST) -> Iterator[int]:
    """Yield the first port of a block for a flight of `drones`, reserved within the context.

    A block is reserved by locks on files, which the kernel releases when the process ends.

    Raises:
        SettingsError: every block is taken.
    """
    size = 2 * drones + 2
    length = -(-size // _UNIT) * _UNIT
    for base in range(first, last - length + 1, _UNIT):
        with contextlib.ExitStack() as held:
            units = range(base, base + length, _UNIT)
            if all(_locked(unit, held) for unit in units) and all(
                _free(port) for port in range(base, base + size)
            ):
                yield base
                return
    raise SettingsError([f"no {size} free ports in a row between {first} and {last}"])


def _locked(unit: int, held: contextlib.ExitStack) -> bool:
    """Return whether the ports from `unit` on are now reserved until `held` is closed."""
    path = Path(tempfile.gettempdir()) / f"swarm-companion-ports-{unit}.lock"
    try:
        # Opened for reading where it exists: another user's file can be locked, too.
        file = held.enter_context(path.open("r" if path.exists() else "a"))
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _free(port: int) -> bool:
    """Return whether no process listens at a port, UDP or TCP."""
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with contextlib.closing(socket.socket(socket.AF_INET, kind)) as s:
            if kind == socket.SOCK_STREAM:
                s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                s.bind(("127.0.0.1", port))
            except OSError:
                return False
    return True
