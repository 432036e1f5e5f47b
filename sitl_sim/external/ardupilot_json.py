"""A user's own ArduCopter SITL on the simulator's physics, by its JSON interface over UDP.

ArduCopter sends PWM and waits for the motion, one line of JSON, whose time stamp moves its clock.
Source: libraries/SITL/SIM_JSON.cpp. Its parser looks for `"key":` and reads what follows at once:
a blank there is an error, and so is a time stamp that does not begin at zero. It cuts each step of
the time stamps down to whole microseconds, and its clock is their sum.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time as wall
from collections.abc import Mapping
from pathlib import Path

from mavlink_bridge.shared.frames import enu_ned, flu_frd, quaternion_enu_ned
from mavlink_bridge.wire.udp import Address
from sitl_sim.external.autopilot_link import AutopilotLink
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl, udp_free
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import LocalFrame

PORT, PORTS_APART, _INSTANCES = 9002, 10, 200
_OTHER_PORTS = (5501,)  # on which instance 0 listens, too
_PWM = struct.Struct("<HHI16H")  # magic, frame rate, frame number, µs of each channel
_MAGIC = 18458
_LOW, _RANGE = 1000, 1000  # µs
# A step of 999.99 µs would count as 999: its clock would lose 0.25 ms each second.
_STRETCH = 1.0 + 1e-7


class ArdupilotSitl(ExternalSitl):
    """ArduCopter, system id `system`; parameters: set at boot; it takes the first free instance."""

    period = 0.001  # with gyro samples at less than 720 Hz it refuses to be armed

    def __init__(
        self,
        binary: str,
        folder: Path,
        system: int,
        parameters: Mapping[str, float],
        frame: LocalFrame,
        clock: float = 0.0,
    ) -> None:
        """frame: the vehicle's own. clock: its time_boot is the time of `send` plus this [s]."""
        super().__init__(folder)
        self._frame, self._clock = frame, clock
        self._socket, instance = _first_free()
        self._socket.setblocking(False)
        self._peer: Address | None = None
        self._frame_number = -1  # of the packet that was received last
        self.links = {"companion": AutopilotLink(), "gcs": AutopilotLink()}
        folder.mkdir(parents=True, exist_ok=True)
        lines = [f"{name} {value:g}\n" for name, value in parameters.items()]
        (folder / "defaults.parm").write_text("".join(lines), encoding="ascii")
        latitude, longitude, altitude = frame.to_geo(frame.origin)
        try:
            self.run(
                [
                    *(binary, "--model", "JSON:127.0.0.1", "-I", str(instance), "-w"),
                    *("--home", f"{latitude:.7f},{longitude:.7f},{altitude:.2f},0"),
                    *("--sysid", str(system), "--defaults", "defaults.parm"),
                    *("--serial0", f"udpclient:127.0.0.1:{self.links['companion'].port}"),
                    *("--serial1", f"udpclient:127.0.0.1:{self.links['gcs'].port}"),
                ]
            )
        except BaseException:
            self.close()
            raise

    @property
    def connected(self) -> bool:
        """Whether ArduCopter has sent its first motor commands."""
        return self._peer is not None or self.receive(0.0)

    def send(self, time: float, i: int, state: State) -> None:
        """Send the motion of vehicle i at `time` [s since its start]."""
        if self._peer is not None:
            line = motion_line(time + self._clock, i, state, self._frame)
            self._socket.sendto(line, self._peer)

    def receive(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for the motor commands of the step; return whether they came."""
        end = wall.monotonic() + timeout
        while select.select([self._socket], [], [], max(end - wall.monotonic(), 0.0))[0]:
            try:
                data, sender = self._socket.recvfrom(256)
            except (BlockingIOError, ConnectionRefusedError):
                continue
            if len(data) != _PWM.size or _PWM.unpack(data)[0] != _MAGIC:
                continue
            number = _PWM.unpack(data)[2]
            if number == self._frame_number:
                continue  # sent again while the simulator was busy
            self._frame_number, self._peer = number, sender
            self._set_motors([(us - _LOW) / _RANGE for us in _PWM.unpack(data)[3:7]])
            return True
        return False

    def close(self) -> None:
        """End the process and release the ports."""
        super().close()
        self._socket.close()


def _first_free() -> tuple[socket.socket, int]:
    """Return a socket on the port of the first instance that runs nowhere here, and its number.

    Raises:
        ExternalError: all instances are taken.
    """
    for instance in range(_INSTANCES):
        shift = PORTS_APART * instance
        if not all(udp_free(port + shift) for port in _OTHER_PORTS):
            continue
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            s.bind(("127.0.0.1", PORT + shift))
        except OSError:
            s.close()
            continue
        return s, instance
    raise ExternalError(f"UDP {PORT} + 10·k: all in use by other simulators")


def motion_line(time: float, i: int, state: State, frame: LocalFrame) -> bytes:
    """Encode the motion of vehicle i at `time` [s]: FRD rates and force, NED place and velocity."""
    rates, force = (flu_frd(*map(float, a[i])) for a in (state.omega, state.specific_force))
    motion = {
        "timestamp": time * _STRETCH,
        "imu": {"gyro": rates, "accel_body": force},
        "position": enu_ned(*map(float, frame.point(state.p[i]))),
        "quaternion": quaternion_enu_ned(frame.attitude(state.q[i])),
        "velocity": enu_ned(*map(float, frame.vector(state.v[i]))),
        "no_time_sync": 1,  # its clock is ours, not the machine's
    }
    return b"\n" + json.dumps(motion, separators=(",", ":")).encode() + b"\n"
