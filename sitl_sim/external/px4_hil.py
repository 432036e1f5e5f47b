"""A user's own PX4 SITL on the simulator's physics, by MAVLink's HIL messages over TCP.

PX4 connects to port 4560 + its instance, takes HIL_SENSOR and HIL_GPS, runs by their time, and
answers with HIL_ACTUATOR_CONTROLS. Source: PX4 modules/simulation/simulator_mavlink. Tested
against a stand-in that implements the interface, not against PX4.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import HilActuators, HilGps, HilSensor, Message
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import LocalFrame

PORT = 4560
_FIELD = np.array([0.01, 0.21, -0.43])  # gauss, ENU: the Earth's, at the geodetic reference
_SENSOR_PERIOD, _GPS_PERIOD = 0.004, 0.1  # s
_QUADROTOR_BY_TCP = "10016"  # PX4's airframe that waits for such a simulator


class Px4Sitl(ExternalSitl):
    """PX4 number `instance` (0…), system id `system`; parameters: set at boot.

    Its own start script sends MAVLink to 14540 + instance and 14550.
    """

    def __init__(
        self, binary: str, folder: Path, instance: int, system: int, parameters: Mapping[str, float]
    ) -> None:
        try:
            self._listener = socket.create_server(("127.0.0.1", PORT + instance))
        except OSError as error:
            raise ExternalError(
                f"TCP {PORT + instance}: {error.strerror}; another SITL?"
            ) from error
        self._listener.setblocking(False)
        self._line: socket.socket | None = None
        self._codec = Codec(1, 1)
        self._sensor_at = self._gps_at = 0.0
        set_at_boot = {"MAV_SYS_ID": float(system)} | dict(parameters)
        environment = {f"PX4_PARAM_{name}": f"{value:g}" for name, value in set_at_boot.items()}
        environment |= {"PX4_SYS_AUTOSTART": _QUADROTOR_BY_TCP}
        scripts = str(Path(binary).resolve().parent.parent / "etc")
        try:
            super().__init__([binary, "-d", "-i", str(instance), scripts], folder, environment)
        except ExternalError:
            self._listener.close()
            raise

    def exchange(self, i: int, state: State, frame: LocalFrame) -> NDArray[np.float64]:
        """Send the sensor messages of vehicle i that are due; return its motor commands (4,)."""
        if self._line is None and not self._accept():
            return self.command
        assert self._line is not None
        try:
            self._line.sendall(self._codec.encode(self._due(time.monotonic(), i, state, frame)))
            for received in self._codec.decode(self._line.recv(65536)):
                if isinstance(received.message, HilActuators):
                    self._set_motors(received.message.controls)
        except BlockingIOError:
            pass
        except OSError:
            self._line.close()
            self._line = None
        return self.command

    def close(self) -> None:
        """End the process, release the port."""
        super().close()
        self._listener.close()
        if self._line is not None:
            self._line.close()

    def _accept(self) -> bool:
        try:
            self._line, _ = self._listener.accept()
        except BlockingIOError:
            return False
        self._line.setblocking(False)
        self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return True

    def _due(self, now: float, i: int, state: State, frame: LocalFrame) -> list[Message]:
        messages: list[Message] = []
        latitude, longitude, altitude = frame.to_geo(state.p[i])
        if now - self._sensor_at >= _SENSOR_PERIOD:
            self._sensor_at = now
            field = rotation_matrix(frame.attitude(state.q[i])).T @ _FIELD
            pressure = 1013.25 * (1.0 - 2.25577e-5 * altitude) ** 5.25588
            messages.append(
                HilSensor(
                    now,
                    state.specific_force[i].copy(),
                    state.omega[i].copy(),
                    field,
                    pressure,
                    altitude,
                )
            )
        if now - self._gps_at >= _GPS_PERIOD:
            self._gps_at = now
            v = frame.vector(state.v[i])
            messages.append(HilGps(now, latitude, longitude, altitude, v))
        return messages
