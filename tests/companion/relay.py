"""A relay between a vehicle and its daemon that knows, from the kernel, when each packet came."""

import socket
import struct
import threading
import time

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, RateSetpoint

_SO_TIMESTAMP = 29  # asm-generic/socket.h; Python has no name for it
_STAMP = struct.Struct("@qq")  # struct timeval
_LISTEN = 0.05  # s between two looks at whether it is over


class Relay:
    """Sits where the vehicle sends to; passes everything on to the daemon's port, and back.

    sent: (time, message) of the daemon; told: of the vehicle; CLOCK_MONOTONIC of the arrival.
    passed_on: CLOCK_MONOTONIC at which the latest setpoint went on to the vehicle.
    """

    def __init__(self, vehicle_sends_to, daemon_port):
        self.sent, self.told = [], []
        self.passed_on = None
        self._inner = self._socket(("127.0.0.1", vehicle_sends_to))
        self._outer = self._socket(("127.0.0.1", 0))
        self._daemon, self._vehicle = ("127.0.0.1", daemon_port), None
        self._over = threading.Event()
        ways = ((self._inner, self.told), (self._outer, self.sent))
        self._threads = [threading.Thread(target=self._carry, args=way) for way in ways]
        for thread in self._threads:
            thread.start()

    @staticmethod
    def _socket(address):
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMP, 1)
        s.settimeout(_LISTEN)
        s.bind(address)
        return s

    def _carry(self, source, into):
        codec = Codec(255, 1)
        while not self._over.is_set():
            try:
                data, extra, _, sender = source.recvmsg(65535, 64)
            except TimeoutError:
                continue
            if source is self._inner:
                self._vehicle = sender
                self._outer.sendto(data, self._daemon)
            elif self._vehicle is not None:
                self._inner.sendto(data, self._vehicle)
            at, passed_on = _arrival(extra), time.monotonic()
            messages = [r.message for r in codec.decode_datagram(data)]
            into.extend((at, m) for m in messages)
            if any(isinstance(m, RateSetpoint) for m in messages):
                self.passed_on = passed_on

    def setpoints(self, since):
        """Arrival of each setpoint from `since` on."""
        return [t for t, m in list(self.sent) if isinstance(m, RateSetpoint) and t >= since]

    def vehicle_clock(self, moment):
        """The vehicle's own time [s] at `moment`, as its newest attitude before told it."""
        return max(m.time for t, m in list(self.told) if t <= moment and isinstance(m, Attitude))

    def until(self, found, since, seconds):
        """Arrival of the vehicle's first message from `since` on for which found(message) holds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for t, m in list(self.told):
                if t >= since and found(m):
                    return t
            time.sleep(_LISTEN)
        raise AssertionError(f"not within {seconds} s")

    def close(self):
        """Release the ports."""
        self._over.set()
        for thread in self._threads:
            thread.join()
        self._inner.close()
        self._outer.close()


def _arrival(extra):
    """CLOCK_MONOTONIC of a packet that the kernel stamped with the wall clock."""
    for level, kind, data in extra:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMP:
            seconds, micros = _STAMP.unpack(data)
            ago = time.clock_gettime(time.CLOCK_REALTIME) - seconds - micros / 1e6
            return time.monotonic() - ago
    raise AssertionError("no time stamp")
