"""When a datagram arrived, by the kernel's own stamp: it loses nothing where it waits to be read.

The stamps (SO_TIMESTAMPNS, socket(7)) are of CLOCK_REALTIME, which a person or NTP may set at any
time. So both clocks are compared in each reading; where the wall clock was set since the last one,
or there is no stamp, a datagram counts as arrived when it is read, as without stamps.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time

_TIMESTAMPNS = 35  # of asm-generic/socket.h; Python has no name for it
_TIMESPEC = struct.Struct("@ll")
NOTES_SIZE = socket.CMSG_SPACE(_TIMESPEC.size)  # bytes that `recvmsg` needs for a stamp
_SET = 1e-3  # s that the clocks may differ from one reading to the next: both are not read at once
_SLEWED = 2e-3  # s/s; NTP slews a clock by up to 5e-4

Notes = list[tuple[int, int, bytes]]  # ancillary data, as `recvmsg` returns it


def stamp_arrivals(port: socket.socket) -> bool:
    """Let the kernel stamp what arrives at a socket; return whether it does."""
    if not sys.platform.startswith("linux"):
        return False
    with contextlib.suppress(OSError):
        port.setsockopt(socket.SOL_SOCKET, _TIMESTAMPNS, 1)
        return True
    return False


class ArrivalClock:
    """Carries the kernel's stamps to CLOCK_MONOTONIC."""

    def __init__(self) -> None:
        self._now = self._wall = 0.0
        self._set = False  # the wall clock, since the reading before
        self.look()
        self._set = False

    def look(self) -> None:
        """Compare both clocks; at the beginning of each reading."""
        before, ahead = self._now, self._wall - self._now
        self._now, self._wall = time.monotonic(), time.clock_gettime(time.CLOCK_REALTIME)
        moved = abs(self._wall - self._now - ahead)
        self._set = moved > _SET + _SLEWED * (self._now - before)

    def arrived(self, notes: Notes) -> float:
        """Return when a datagram of this reading arrived [s, CLOCK_MONOTONIC]."""
        for level, kind, data in notes:
            if level == socket.SOL_SOCKET and kind == _TIMESTAMPNS and not self._set:
                seconds, nanoseconds = _TIMESPEC.unpack(data)
                waited: float = self._wall - seconds - nanoseconds * 1e-9
                return self._now - max(waited, 0.0)
        return self._now
