"""A port of the host that leads to MSP and CLI of a Betaflight SITL inside a namespace."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable

from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.priority import BRIDGE, raise_priority


class Relay:
    """A port of the host that leads into a namespace; each client gets its own connection."""

    def __init__(self, connect: Callable[[], socket.socket]) -> None:
        self._connect = connect
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._lines: list[socket.socket] = []
        self._pumps: list[threading.Thread] = []
        self._acceptor = threading.Thread(target=self._accept, daemon=True)
        self._acceptor.start()

    @property
    def port(self) -> int:
        """The port number."""
        return int(self._listener.getsockname()[1])

    def close(self) -> None:
        """Close all connections, and end all threads."""
        _wake(self._listener)  # without this, the thread would stay in accept()
        self._acceptor.join()
        self._listener.close()
        for line in self._lines:
            _wake(line)
        for pump in self._pumps:
            pump.join()
        for line in self._lines:
            line.close()

    def _accept(self) -> None:
        raise_priority(BRIDGE)
        while True:
            try:
                caller, _ = self._listener.accept()
                self._lines.append(caller)
                line = self._connect()
            except (OSError, ExternalError):
                return
            self._lines.append(line)
            for a, b in ((caller, line), (line, caller)):
                a.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._pumps.append(threading.Thread(target=_pump, args=(a, b), daemon=True))
                self._pumps[-1].start()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    """Copy bytes from one end to the other, until either is closed."""
    with contextlib.suppress(OSError):
        while data := source.recv(4096):
            sink.sendall(data)
    for end in (source, sink):
        _wake(end)


def _wake(line: socket.socket) -> None:
    """Shut a socket down, so that a thread which waits on it goes on."""
    with contextlib.suppress(OSError):
        line.shutdown(socket.SHUT_RDWR)
