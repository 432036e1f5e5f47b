"""A user's own PX4 SITL on the simulator's physics, by MAVLink's HIL messages over TCP.

PX4 connects to port 4560 + its instance, takes HIL_SENSOR and HIL_GPS, runs by their time, and
answers each HIL_SENSOR with HIL_ACTUATOR_CONTROLS. Source: PX4 modules/simulation/
simulator_mavlink, ROMFS/px4fmu_common/init.d-posix. Flown with PX4 1.17.
"""

from __future__ import annotations

import fcntl
import select
import socket
import time
from collections.abc import Mapping
from pathlib import Path

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import HilActuators, Message
from sitl_sim.external.autopilot_link import AutopilotLink
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl, udp_free
from sitl_sim.external.hil_sensors import GPS_PERIOD, IMU_PERIOD, HilSensors
from sitl_sim.vehicles.rigid_body import State

PORT = 4560
_COMPANION_PORT, _GROUND_PORT = 14580, 18570  # on which instance 0 listens
_INSTANCES = 200
_LOCK = "/tmp/px4_lock"  # PX4 locks this file, its instance appended
_QUADROTOR_BY_TCP = "10016"  # PX4's airframe that waits for such a simulator


class Px4Sitl(ExternalSitl):
    """PX4, system id `system`; parameters: set at boot; it takes the first free instance."""

    period = IMU_PERIOD

    def __init__(
        self,
        binary: str,
        folder: Path,
        system: int,
        parameters: Mapping[str, float],
        sensors: HilSensors,
        clock: float = 0.0,
    ) -> None:
        """clock: its time_boot is the time of `send` plus this [s]."""
        super().__init__(folder)
        self._sensors, self._clock = sensors, clock
        self._listener, self.instance = _first_free()
        self._listener.setblocking(False)
        self._line: socket.socket | None = None
        self._codec = Codec(1, 1)
        self._gps_at = 0.0
        self.links = {
            "companion": AutopilotLink(("127.0.0.1", _COMPANION_PORT + self.instance)),
            "gcs": AutopilotLink(("127.0.0.1", _GROUND_PORT + self.instance)),
        }
        set_at_boot = {"MAV_SYS_ID": float(system)} | dict(parameters)
        environment = {f"PX4_PARAM_{name}": f"{value:g}" for name, value in set_at_boot.items()}
        environment |= {"PX4_SYS_AUTOSTART": _QUADROTOR_BY_TCP}
        scripts = str(Path(binary).resolve().parent.parent / "etc")
        try:
            self.run([binary, "-d", "-i", str(self.instance), scripts], environment)
        except BaseException:
            self.close()
            raise

    @property
    def connected(self) -> bool:
        """Whether PX4 has connected to the simulator."""
        return self._line is not None or self._accept()

    def send(self, time: float, i: int, state: State) -> None:
        """Send the sensor messages of vehicle i that are due at `time` [s since its start]."""
        if self._line is None:
            return
        now = time + self._clock
        messages: list[Message] = [self._sensors.imu(now, i, state)]
        if time >= self._gps_at:
            self._gps_at = time + GPS_PERIOD
            messages.append(self._sensors.gps(now, i, state))
        try:
            self._line.sendall(self._codec.encode(messages))
        except OSError:
            self._hang_up()

    def receive(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for the motor commands of the step; return whether they came."""
        end = time.monotonic() + timeout
        while self._line is not None:
            if not select.select([self._line], [], [], max(end - time.monotonic(), 0.0))[0]:
                return False
            try:
                data = self._line.recv(65536)
            except OSError:
                data = b""
            if not data:
                self._hang_up()
                return False
            answers = [r.message for r in self._codec.decode(data)]
            commands = [m for m in answers if isinstance(m, HilActuators)]
            if commands:
                self._set_motors(commands[-1].controls)
                return True
        return False

    def close(self) -> None:
        """End the process and release the ports."""
        super().close()
        self._listener.close()
        self._hang_up()

    def _hang_up(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    def _accept(self) -> bool:
        try:
            self._line, _ = self._listener.accept()
        except BlockingIOError:
            return False
        self._line.settimeout(1.0)
        self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return True


def _locked(instance: int) -> bool:
    """Return whether a PX4 of this number runs, in another network namespace too."""
    try:
        with Path(f"{_LOCK}-{instance}").open("r+b") as file:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # closing it lets go
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False


def _first_free() -> tuple[socket.socket, int]:
    """Return a listener for the first instance that runs nowhere on this host, and its number.

    Raises:
        ExternalError: all instances are taken.
    """
    for instance in range(_INSTANCES):
        ports = (_COMPANION_PORT + instance, _GROUND_PORT + instance)
        if _locked(instance) or not all(map(udp_free, ports)):
            continue
        try:
            return socket.create_server(("127.0.0.1", PORT + instance)), instance
        except OSError:
            continue
    raise ExternalError(f"TCP {PORT}…{PORT + _INSTANCES - 1}: all in use by other simulators")
