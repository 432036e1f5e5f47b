"""Notices to systemd: ready, alive, stopping; sd_notify(3) without a library.

Every notice is one datagram to the socket named in NOTIFY_SOCKET. Without such a socket, and when
the listener is gone, nothing happens: being watched never disturbs the flight.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Mapping

# Until READY, each notice that the start goes on allows it this much longer [µs].
_START_EXTENSION = 15_000_000


class ServiceManager:
    """The service manager behind NOTIFY_SOCKET of `environment`, if there is one."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._socket: socket.socket | None = None
        address = environment.get("NOTIFY_SOCKET", "")
        if address[:1] in ("/", "@"):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
            self._address = "\0" + address[1:] if address.startswith("@") else address

    def starting(self, status: str) -> None:
        """Tell that the daemon waits for something outside, and is not stuck."""
        self._notify(f"STATUS={status}", f"EXTEND_TIMEOUT_USEC={_START_EXTENSION}")

    def ready(self, status: str) -> None:
        """Tell that start-up is over; from now on the watchdog counts."""
        self._notify("READY=1", f"STATUS={status}", "WATCHDOG=1")

    def alive(self) -> None:
        """Feed the watchdog."""
        self._notify("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows."""
        self._notify(f"STATUS={text}")

    def stopping(self) -> None:
        """Tell that an orderly end has begun."""
        self._notify("STOPPING=1", "STATUS=stopping")

    def close(self) -> None:
        """Send no more notices."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _notify(self, *lines: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)
