"""One daemon for each vehicle: an abstract socket that dies with the process that holds it.

A lock file would outlive a crash, and needs a folder that every user may write to.
"""

from __future__ import annotations

import errno
import hashlib
import socket
import struct


class VehicleTaken(OSError):
    """Another process holds the vehicle; the message says which."""


class VehicleLock:
    """A lock held from construction to `close`, or to the end of the process.

    vehicle: the endpoint and the system id, which two daemons must not share.

    Raises:
        VehicleTaken: another process holds the lock. OSError: the kernel refuses the socket.
    """

    def __init__(self, vehicle: str) -> None:
        # A hash: an address has at most 108 bytes, and a device by its id may have more.
        address = f"\0swarm-companion/{hashlib.sha256(vehicle.encode()).hexdigest()}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            if error.errno != errno.EADDRINUSE:
                raise
            raise VehicleTaken(
                f"vehicle {vehicle} is flown by another daemon already{_holder(address)}"
            ) from None
        self._socket.listen(1)

    def close(self) -> None:
        """Release the vehicle."""
        self._socket.close()


def _holder(address: str) -> str:
    """Return `, process 123`, the holder as the kernel knows it; empty where it just ended."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(address)
            credentials = probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
        except OSError:
            return ""
    return f", process {struct.unpack('iii', credentials)[0]}"
