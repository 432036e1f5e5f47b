"""A window: the world of a scenario around one vehicle that has physics of its own.

The vehicle is PX4's SIH, a Gazebo model, or a real drone on a bench. Its MAVLink tells where it is;
a camera picture of the scenario's world at that pose goes to its companion, stamped with the
vehicle's own time. The companion flies the vehicle over a link of its own, which the window does
not need. The truth is where a simulator says that the vehicle is, else where the vehicle believes
to be; its velocity is that with which this place moves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import euler_from_quaternion, multiply
from mavlink_bridge.wire.messages import VehicleState
from mavlink_bridge.wire.video import Frame, FrameServer
from sitl_sim.external.watched_vehicle import WatchedVehicle
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.flight.inputs import whose_targets, write_inputs, write_world
from sitl_sim.flight.sensors import Sensors
from sitl_sim.recording.run_folder import OwnFrame
from sitl_sim.recording.truth import RATE_HZ, Truth
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import companion_config
from sitl_sim.scenarios.scenario import TICK_MS, Scenario
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame
from sitl_sim.worlds.ground import Ground
from sitl_sim.worlds.world import surface_distance

LEAD = 0.05  # s from a picture to the companion's tick: a pose at 50 Hz, its way here, rendering
_SILENT = 2.0  # s without telemetry that are worth a word
_STEP = 1.0 / RATE_HZ  # s of the vehicle's clock between two instants of the truth
_PERIOD = TICK_MS / 1e3
_READS = 1.0  # s (wall) in which a companion has to read a picture
_ROUNDING = 1e-6  # s


@dataclass(frozen=True)
class _Bodies:
    """The one vehicle as the truth takes it: arrays (1,…), world."""

    p: Vector
    v: Vector
    q: Vector


class Window:
    """World, frame channel and truth around one vehicle.

    contacts: how often it flew into an obstacle. ages: of each picture when it was sent [s], by the
    vehicle's clock as it is heard here.

    Raises:
        SettingsError: the scenario cannot be shown.
        VideoError: the port of the frame channel is in use.
    """

    def __init__(
        self, scenario: Scenario, folder: Path, vehicle: WatchedVehicle, say: Callable[[str], None]
    ) -> None:
        """Build the world; say: tells the user something while the window is open."""
        self.scenario, self.folder, self.vehicle = scenario, folder, vehicle
        self.names = scenarios.drone_names(scenario)
        self._start = placement.starts(scenario)
        self.world: dict[str, Any] = {
            "drone_radius": scenario.drones.airframe(0).radius,
            **build(scenario.world, scenario.seed),
            **whose_targets(scenario, self._start),
            "target_tolerance": scenario.mission.tolerance,
        }
        self.truth = Truth(self.names)
        self.contacts = 0
        self.ages: list[float] = []
        self.wall_seconds = 0.0
        self.stopped_by: int | None = None
        self._say = say
        self._ground = Ground(self.world)
        self._sensors = Sensors(scenario, self.world)
        self._frames = FrameServer(scenario.wire.host, self.frame_port, _READS)
        self._lead = max(scenario.sensing.latency, LEAD)
        self._own: LocalFrame | None = None  # the vehicle's frame in the world
        self._seen: LocalFrame | None = None  # the frame of its poses in the world
        self._boot: float | None = None  # s, its clock when the truth began
        self._next_instant = self._next_picture = 0.0  # s, its clock
        self._landed = self._silent = self._touching = False

    @property
    def frame_port(self) -> int:
        """TCP port of the frame channel."""
        return self.scenario.wire.frame_port + self.vehicle.system

    # --- setting up ----------------------------------------------------------------------

    def find_vehicle(self) -> None:
        """Wait for the vehicle, and set the world around it.

        It then stands at the scenario's start and faces as the scenario says, wherever it is and
        points in its own frame.

        Raises:
            ExternalError: the vehicle is not heard, or not what is needed.
            KeyboardInterrupt: the window was stopped.
        """
        state = self.vehicle.await_stand(lambda: self.stopped_by is not None)
        heading = float(placement.headings(self.scenario, self._start)[0])
        yaw = heading - euler_from_quaternion(state.q_wb)[2]
        self._own = self._standing(state.p, yaw)
        poses = self.vehicle.poses
        pose = poses.at(poses.known_until)
        self._seen = self._own if pose is None else self._standing(pose.p, yaw)
        if self.vehicle.knows_truth:
            self.world["targets_by"] = "estimate"
        # The first picture takes seconds, as kernels are loaded; nothing must wait for it later.
        self._sensors.frame(0, 0.0, self._start, state.q_wb[None])

    def _standing(self, p: Vector, yaw: float) -> LocalFrame:
        """Return the frame, turned by `yaw` [rad], in which the point p (3,) m is the start."""
        there = LocalFrame(np.zeros(3), yaw, GeoReference()).to_world(p)
        return LocalFrame(self._start[0] - np.array(there), yaw, GeoReference())

    def write_inputs(self, companion: str) -> Path:
        """Write scenario, world and the companion's config; return the path of the config.

        companion: the endpoint at which the companion hears the vehicle.

        Raises:
            SettingsError: the folder holds a flight, or cannot be created.
            ExternalError: no companion can fly this autopilot.
        """
        system, kind = self.vehicle.system, self.vehicle.autopilot
        config = companion_config(
            self.scenario,
            0,
            self.folder,
            clock=True,
            link={"endpoint": companion, "system_id": system, "autopilot": kind},
            frame=self._own,
        )
        config["camera"]["source"] = f"sim:{self.scenario.wire.host}:{self.frame_port}"
        write_inputs(self.folder, self.scenario, self.world, {self.names[0]: config})
        return self.folder / "drones" / self.names[0] / "config.yaml"

    # --- showing the world ----------------------------------------------------------------

    def run(self) -> None:
        """Show the world until the companion's mission is over, the vehicle reboots, or `stop`."""
        started, restarts = time.monotonic(), self.vehicle.believed.restarts
        while self.stopped_by is None and not self._landed:
            self.step(0.02)
            if self.vehicle.believed.restarts > restarts:
                self._say("the vehicle has started anew: its place in the world is lost")
                break
        self.wall_seconds = time.monotonic() - started

    def stop(self, number: int) -> None:
        """Stop at the next instant, for the signal of this number."""
        self.stopped_by = number

    def step(self, timeout: float) -> None:
        """Read what the vehicle sends within `timeout` [s]; send and record what is due."""
        self.vehicle.listen(timeout)
        known = self.vehicle.poses.known_until
        if not self._frames.connected or not math.isfinite(known):
            return
        if self._boot is None:
            self._begin(known)
        self._watch_silence()
        while self._next_instant + _STEP <= known + _ROUNDING:
            self._record(self._next_instant)
            self._next_instant += _STEP
        self._take_picture(known)
        while (answer := self._frames.answer(0.0)) is not None:
            self._landed |= answer.done

    def _begin(self, now: float) -> None:
        """Begin the truth: a companion has come."""
        assert self._own is not None
        self._boot = self._next_instant = math.ceil(now / _PERIOD) * _PERIOD
        self._next_picture = self._boot + _PERIOD - self._lead
        frame = OwnFrame(self._own.origin, self._own.yaw, self._boot)
        self.world["frames"] = {self.names[0]: frame.as_data()}
        write_world(self.folder, self.world)

    def _watch_silence(self) -> None:
        silent = time.monotonic() - self.vehicle.heard_at > _SILENT
        if silent and not self._silent:
            self._say(f"the vehicle is silent: no pose for {_SILENT:g} s")
        self._silent = silent

    def _state(self, at: float) -> VehicleState | None:
        """Return the vehicle's state in the world; None where it was silent around `at` [s]."""
        frame, poses = self._seen, self.vehicle.poses
        state = poses.at(min(at, poses.known_until))
        if frame is None or state is None:
            return None
        turned = LocalFrame(np.zeros(3), frame.yaw, GeoReference())
        turn = np.array([math.cos(frame.yaw / 2), 0.0, 0.0, math.sin(frame.yaw / 2)])
        return replace(
            state,
            p=np.array(frame.to_world(state.p)),
            v=np.array(turned.to_world(state.v)),
            q_wb=multiply(turn, state.q_wb),
        )

    def _record(self, at: float) -> None:
        """Append the instant `at` [s, vehicle's clock] to the truth; count contacts."""
        state = self._state(at)
        if state is None or self._boot is None:
            return
        t = round(at - self._boot, 6)
        before, after = self._state(at - _STEP), self._state(at + _STEP)
        v = state.v
        if before is not None and after is not None:
            v = (after.p - before.p) / (2.0 * _STEP)
        bodies = _Bodies(state.p[None], v[None], state.q_wb[None])
        armed = np.array([self.vehicle.armed])
        self.truth.record(t, bodies, armed, self._estimate(at, state))
        above = float(state.p[2] - self._ground.height(*state.p[:2]))
        gap = float(surface_distance(state.p, self.world)) - self.world["drone_radius"]
        touching = above > AIRBORNE and gap < 0.0
        if touching and not self._touching:
            self.contacts += 1
            self._say(f"contact {self.contacts} with an obstacle, {t:.1f} s")
        self._touching = touching

    def _estimate(self, at: float, state: VehicleState) -> Vector | None:
        """Return where the vehicle believed to be (1,3) m, where it truly was is another matter."""
        if not self.vehicle.knows_truth or self._own is None:
            return None
        believed = self.vehicle.believed.at(min(at, self.vehicle.believed.known_until))
        return state.p[None] if believed is None else np.array([self._own.to_world(believed.p)])

    def _take_picture(self, known: float) -> None:
        """Send the newest picture that is due; older ones are lost, as a busy camera's are."""
        behind = known - self._next_picture + _ROUNDING
        if behind < 0.0:
            return
        at = self._next_picture + int(behind / _PERIOD) * _PERIOD
        self._next_picture = at + _PERIOD
        state = self._state(at)
        if state is None:
            return
        arrays = self._sensors.frame(0, at, state.p[None], state.q_wb[None])
        if self._frames.send(Frame(at, arrays)):
            waited = time.monotonic() - self.vehicle.heard_at
            self.ages.append(self.vehicle.poses.newest - at + waited)

    # --- as a flight ----------------------------------------------------------------------

    @property
    def shown(self) -> bool:
        """Whether a companion came, so that there is a truth."""
        return self._boot is not None and self._next_instant > self._boot

    @property
    def simulated_seconds(self) -> float:
        """How long the window was open, by the vehicle's clock [s]."""
        return 0.0 if self._boot is None else self._next_instant - self._boot

    def exit_codes(self) -> dict[str, int | None]:
        """Return no codes: the companion is not the window's."""
        return dict.fromkeys(self.names)

    def close(self) -> None:
        """Release the ports."""
        self._frames.close()
        self.vehicle.close()


@contextmanager
def open_window(
    scenario: Scenario, folder: Path, url: str, system: int, say: Callable[[str], None]
) -> Iterator[Window]:
    """Yield a window whose ports are released in every case; arguments as of its parts."""
    vehicle = WatchedVehicle(url, system)
    try:
        window = Window(scenario, folder, vehicle, say)
    except BaseException:
        vehicle.close()
        raise
    try:
        yield window
    finally:
        window.close()
