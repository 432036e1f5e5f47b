"""A user's own ArduCopter SITL on the simulator's physics, by its JSON interface over UDP.

ArduCopter sends PWM at its own pace; each packet is answered at once with the motion, one line of
JSON. Source: libraries/SITL/SIM_JSON.cpp and examples/JSON/readme.md. Tested against a stand-in
that implements the interface, not against ArduCopter.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.frames import enu_ned, flu_frd, quaternion_enu_ned
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

PORT, PORTS_APART = 9002, 10
_PWM = struct.Struct("<HHI16H")  # magic, frame rate, frame number, µs of each channel
_MAGIC = 18458
_LOW, _RANGE = 1000, 1000  # µs
_FRAME = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}  # quadrotor, X


class ArdupilotSitl(ExternalSitl):
    """ArduCopter number `instance` (0…), system id `system`.

    companion, ground: `HOST:PORT` that its MAVLink is sent to. parameters: set at boot.
    """

    def __init__(
        self,
        binary: str,
        folder: Path,
        instance: int,
        system: int,
        companion: str,
        ground: str,
        parameters: Mapping[str, float],
        reference: GeoReference,
    ) -> None:
        port = PORT + PORTS_APART * instance
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise ExternalError(f"UDP {port}: {error.strerror}; another SITL?") from error
        folder.mkdir(parents=True, exist_ok=True)
        lines = [f"{name} {value:g}\n" for name, value in (_FRAME | dict(parameters)).items()]
        (folder / "defaults.parm").write_text("".join(lines), encoding="ascii")
        home = f"{reference.latitude_deg},{reference.longitude_deg},{reference.altitude},0"
        try:
            super().__init__(
                [
                    binary,
                    "--model",
                    "JSON:127.0.0.1",
                    "-I",
                    str(instance),
                    "--home",
                    home,
                    "--sysid",
                    str(system),
                    "--defaults",
                    "defaults.parm",
                    "--serial0",
                    f"udpclient:{companion}",
                    "--serial1",
                    f"udpclient:{ground}",
                ],
                folder,
            )
        except ExternalError:
            self._socket.close()
            raise

    def exchange(self, i: int, state: State, frame: LocalFrame) -> NDArray[np.float64]:
        """Answer the newest PWM with the motion of vehicle i; return the motor commands (4,)."""
        peer = None
        while True:
            try:
                data, sender = self._socket.recvfrom(256)
            except (BlockingIOError, ConnectionRefusedError):
                break
            if len(data) == _PWM.size and _PWM.unpack(data)[0] == _MAGIC:
                peer = sender
                self._set_motors([(us - _LOW) / _RANGE for us in _PWM.unpack(data)[3:7]])
        if peer is not None:
            self._socket.sendto(motion_line(time.monotonic(), i, state, frame), peer)
        return self.command

    def close(self) -> None:
        """End the process, release the port."""
        super().close()
        self._socket.close()


def motion_line(now: float, i: int, state: State, frame: LocalFrame) -> bytes:
    """Encode the motion of vehicle i at `now` [s]: FRD rates and force, NED place and velocity."""
    rates, force = (flu_frd(*map(float, a[i])) for a in (state.omega, state.specific_force))
    motion = {
        "timestamp": now,
        "imu": {"gyro": rates, "accel_body": force},
        "position": enu_ned(*map(float, frame.point(state.p[i]))),
        "quaternion": quaternion_enu_ned(frame.attitude(state.q[i])),
        "velocity": enu_ned(*map(float, frame.vector(state.v[i]))),
    }
    return b"\n" + json.dumps(motion).encode() + b"\n"
