"""Network namespaces of Linux: programs with fixed ports side by side (needs root)."""

from __future__ import annotations

import ctypes
import fcntl
import os
import socket
import struct
import threading
from collections.abc import Callable
from typing import TypeVar

_Result = TypeVar("_Result")
_CLONE_NEWNET = 0x40000000
_SIOCSIFFLAGS, _IFF_UP = 0x8914, 0x1
_libc = ctypes.CDLL(None, use_errno=True)


class NamespaceError(RuntimeError):
    """A namespace cannot be created; the message says what is missing."""


class Namespace:
    """A network namespace with a loopback of its own.

    Sockets and processes that `run` creates belong to it, wherever they are used.
    """

    def __init__(self) -> None:
        self._file = -1
        _in_thread(self._create)

    def _create(self) -> None:
        if _libc.unshare(_CLONE_NEWNET) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise NamespaceError(f"several vehicles need a network namespace each (root): {reason}")
        self._file = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            fcntl.ioctl(s, _SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", _IFF_UP))

    def run(self, make: Callable[[], _Result]) -> _Result:
        """Call `make()` inside the namespace and return its result."""

        def inside() -> _Result:
            if _libc.setns(self._file, _CLONE_NEWNET) != 0:
                raise NamespaceError(f"namespace lost: {os.strerror(ctypes.get_errno())}")
            return make()

        return _in_thread(inside)

    def close(self) -> None:
        """Release the namespace; it ends with its last process and socket."""
        os.close(self._file)


class Host:
    """The host's own network, for a single vehicle."""

    def run(self, make: Callable[[], _Result]) -> _Result:
        """Call `make()` and return its result."""
        return make()

    def close(self) -> None:
        """Do nothing."""


def _in_thread(make: Callable[[], _Result]) -> _Result:
    """Call in a new thread that ends afterwards: a thread that enters a namespace stays in it."""
    results: list[_Result] = []
    errors: list[BaseException] = []

    def call() -> None:
        try:
            results.append(make())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    return results[0]
