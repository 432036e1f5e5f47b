"""One flight: the world, its vehicles, and N companions as processes or inside this process.

Lockstep: the world advances only to the instant at which an answer is due; meanwhile frames are
rendered and companions tick side by side. Real time: the world waits for no companion.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.udp import UdpEndpoint
from mavlink_bridge.wire.video import FrameServer
from sitl_sim.external.fleet import RealFleet
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.faults import catalogue as faults
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.world import FaultyWorld
from sitl_sim.flight.autopilots import foreign_fleet, switch_on, true_airframes
from sitl_sim.flight.delays import Delays
from sitl_sim.flight.exchange import TELEMETRY_MS, Exchange
from sitl_sim.flight.garbage import spared_collector
from sitl_sim.flight.hosts import Host, HostedFrames
from sitl_sim.flight.in_process import LocalFrames, make_pools
from sitl_sim.flight.inputs import whose_targets, write_inputs, write_world
from sitl_sim.flight.sensors import Capture, Sensors, captured
from sitl_sim.flight.signed_lines import key_of
from sitl_sim.flight.vehicle_connection import Ends, VehicleConnection, connect
from sitl_sim.recording.run_folder import own_frames
from sitl_sim.recording.truth import Truth
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import check_companions, companion_config, companion_port
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.foreign import ForeignFleet
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.ground import Ground
from sitl_sim.worlds.world import Occluders

_CONNECT_TIMEOUT = 60.0  # s


class Flight:
    """World, vehicles and wire of one flight; `run` flies it.

    stopped_by: the signal that stopped it, None where it ended by itself.

    Raises:
        EndpointError, VideoError: a port is in use; the message names it.
        SettingsError: the scenario, or a companion's configuration, is wrong.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        real_time: bool = False,
        in_process: bool = False,
        hosts: int = 0,
    ) -> None:
        """Build everything; folder: the run folder, into which `write_inputs` writes first.

        hosts: processes among which the companions of an in-process flight are shared; 0: none.
        """
        self.scenario = scenario
        self.folder = folder
        self._in_process = in_process
        self.names = scenarios.drone_names(scenario)
        self.key = key_of(scenario.seed) if scenario.drones.signing else None
        self._schedule = scenarios.fault_schedule(scenario)
        faults.check(scenario.faults, processes=not in_process)
        check_companions(scenario, in_process)
        self._with_companion = set(scenarios.companion_names(scenario))
        self._foreign = set(scenarios.foreign_names(scenario))
        start = placement.starts(scenario)
        self.world: dict[str, Any] = {
            "drone_radius": scenario.drones.radius,
            **build(scenario.world, scenario.seed),
            **whose_targets(scenario, start),
            "target_tolerance": scenario.mission.tolerance,
        }
        drifts = scenario.drones.state != "mocap" and not scenario.drones.real
        if drifts:
            self.world["targets_by"] = "estimate"
        self._ground = Ground(self.world)
        radii = {n: scenario.drones.airframe(i).radius for i, n in enumerate(self.names)}
        self.world["drone_radius"] = max(radii.values())
        if len(set(radii.values())) > 1:
            self.world["drone_radii"] = radii
        self.vehicles = Vehicles(
            true_airframes(scenario), start, placement.headings(scenario, start)
        )
        boot_ms = placement.boot_ms(scenario)
        self._hosts = [Host(scenario, self.world) for _ in range(hosts)] if in_process else []
        self.sensors = Sensors(scenario, self.world, renders=not self._hosts)
        self._real_time = real_time or scenario.drones.own_time
        if self._real_time:
            self.sensors.warm_up(self.vehicles.p, self.vehicles.q)
        self._drones: list[VehicleConnection] = []
        for i, name in enumerate(self.names):
            camera = FaultyCamera(self._schedule, i)
            ends = self._wire(i + 1, camera)
            self._drones.append(
                connect(name, i, boot_ms[i], ends, camera, self._schedule, self.key)
            )
        try:  # after the ports: an autopilot must not start where another flight runs
            self._autopilots = switch_on(
                scenario, self.vehicles, folder, start, boot_ms, self._ground
            )
        except BaseException:
            self.close()
            raise
        if isinstance(self._autopilots, LockstepFleet):
            self._set_clocks(self._autopilots.clock_ms)
        elif isinstance(self._autopilots, Autopilots):  # real ones pass messages on themselves
            for drone in self._drones:
                drone.route()
        self._pilots: ForeignFleet | None = None
        if self._foreign and isinstance(self._autopilots, Autopilots):
            trunks = Occluders(self.world).cylinders[:, :3]
            self._pilots = foreign_fleet(scenario, self._autopilots, start, trunks)
        self._faults = FaultyWorld(
            self._schedule,
            self.vehicles,
            self._autopilots if isinstance(self._autopilots, Autopilots) else None,
            lambda i: self._drones[i].process_id,
            self._restart_clock,
            wind=scenario.wind.mean,
        )
        self.truth = Truth(self.names)
        self._drifts = drifts
        self._delays = Delays(scenario)
        # Threads pay only where a frame takes time in this process.
        waits = self.sensors.renders or (self._real_time and not in_process)
        self._exchange = Exchange(
            scenario,
            self._schedule,
            self.vehicles,
            self._autopilots,
            self._delays,
            self._capture,
            make_pools(in_process, waits),
            self._real_time,
        )
        self.wall_seconds = 0.0
        self.stopped_by: int | None = None
        self._now = 0  # ms since the flight began

    # --- setting up ----------------------------------------------------------------------

    def _wire(self, system: int, camera: FaultyCamera) -> Ends:
        """Return the simulator's ends of the lines to a vehicle's companion and ground stations."""
        if self._in_process:
            frames = LocalFrames()
            if self._hosts:
                host = self._hosts[system % len(self._hosts)]
                frames = HostedFrames(host, system - 1, camera)
            return frames, MemoryEndpoint(), MemoryEndpoint()
        wire, timeout = self.scenario.wire, self.scenario.timing.answer_timeout
        try:
            return (
                FrameServer(wire.host, wire.frame_port + system, timeout, not self._real_time),
                UdpEndpoint(remote=(wire.host, companion_port(wire, system))),
                UdpEndpoint(remote=(wire.host, wire.gcs_port)),
            )
        except (OSError, ValueError):
            self.close()
            raise

    def _set_clocks(self, boot_ms: Sequence[int]) -> None:
        """Take what the vehicles' clocks show now [ms], and note it for those who read the logs."""
        self.world["frames"] = {}
        for drone, ms, frame in zip(
            self._drones, boot_ms, own_frames(self.scenario, {}), strict=True
        ):
            drone.boot_ms = ms
            self.world["frames"][drone.name] = replace(frame, boot=ms / 1e3).as_data()

    def _restart_clock(self, i: int) -> None:
        """Let drone i's clock begin at 0 again; its camera stamps by it."""
        self._drones[i].boot_ms = -self._now

    def frame_arrays(self, name: str) -> Mapping[str, NDArray[Any]]:
        """Return the arrays of the last frame that a companion of this process got."""
        frames = self._drones[self.names.index(name)].frames
        return frames.arrays if isinstance(frames, LocalFrames) else {}

    def wire_table(self) -> list[str]:
        """Return a line for each vehicle with a companion: its system id and its ports."""
        if self._in_process:
            return []
        w = self.scenario.wire
        return [
            f"{d.name}: system {d.index + 1}, companion UDP {companion_port(w, d.index + 1)}, "
            f"frames TCP {w.frame_port + d.index + 1}, ground station UDP {w.gcs_port}"
            for d in self._drones
            if d.name in self._with_companion
        ]

    def write_inputs(self) -> None:
        """Write scenario, world and each companion's config into the run folder.

        Raises:
            SettingsError: the folder holds a flight, or cannot be created.
        """
        companions = {
            d.name: self.companion_config(d.index)
            for d in self._drones
            if d.name in self._with_companion
        }
        write_inputs(self.folder, self.scenario, self.world, companions, self.key)

    def companion_config(self, i: int) -> dict[str, Any]:
        """Return the configuration of drone i's companion."""
        return companion_config(self.scenario, i, self.folder, clock=self._real_time)

    def launch(self) -> None:
        """Start a companion for each drone that has one.

        Raises:
            KeyboardInterrupt: the flight was stopped.
        """
        urgent = isinstance(self._autopilots, RealFleet)
        for host in self._hosts:
            host.start()
        for drone in self._drones:
            self._raise_if_stopped()
            if drone.name in self._with_companion:
                drone.launch(self.folder / "drones" / drone.name, urgent)

    def wait_for_companions(self) -> None:
        """Wait until every launched companion is on its frame channel.

        Raises:
            RuntimeError: a companion ended (with the end of its output), or time ran out.
            KeyboardInterrupt: the flight was stopped.
        """
        deadline = time.monotonic() + _CONNECT_TIMEOUT
        for drone in self._drones:
            self._raise_if_stopped()
            while not drone.ready(self.folder / "drones" / drone.name, deadline):
                time.sleep(0.01)
                self._raise_if_stopped()  # first: Ctrl-C ends the companions, too

    # --- flying --------------------------------------------------------------------------

    def run(
        self, progress: Callable[[float], None] = lambda t: None, until_stopped: bool = False
    ) -> None:
        """Fly until every drone of ours has landed, the time limit, or `stop`.

        progress: called with the simulated time [s]. until_stopped: only `stop` ends the flight.

        Raises:
            KeyboardInterrupt: the flight was stopped before its first instant.
        """
        self._raise_if_stopped()
        limit = round(self.scenario.mission.time_limit * 1e3)
        started = time.monotonic()
        if isinstance(self._autopilots, RealFleet):
            self._autopilots.begin(started)
            self._set_clocks([round(started * 1e3)] * len(self._drones))  # CLOCK_MONOTONIC
            write_world(self.folder, self.world)
        with spared_collector():
            self._fly(limit, started, progress, until_stopped)
        self.wall_seconds = time.monotonic() - started

    def _fly(
        self, limit: int, started: float, progress: Callable[[float], None], until_stopped: bool
    ) -> None:
        """Live instant after instant; limit: ms. started: CLOCK_MONOTONIC [s]."""
        earliest, speed = started, self.scenario.timing.speed
        while until_stopped or (self._now < limit and not self._over()):
            if self.stopped_by is not None:
                break
            if self._real_time:
                self._idle_until(max(started + self._now / 1e3 / speed, earliest))
            self._instant()
            following = self._next_event()
            # A world that was held up catches up at twice its pace, no faster: to a vehicle that
            # lives a second at once, every companion is silent for a second.
            earliest = time.monotonic() + (following - self._now) / 2e3 / speed
            self._faults.update(self._now / 1e3)
            wind = self._faults.wind(self._now / 1e3)
            self._autopilots.advance(following / 1e3, wind)
            self._now = following
            progress(self._now / 1e3)

    def stop(self, number: int) -> None:
        """Stop the flight at the next instant, for the signal of this number."""
        self.stopped_by = number

    def _raise_if_stopped(self) -> None:
        if self.stopped_by is not None:
            raise KeyboardInterrupt

    @property
    def simulated_seconds(self) -> float:
        """Simulated time since the flight began [s]."""
        return self._now / 1e3

    def _over(self) -> bool:
        """Return whether all of ours have landed, or lost their companions and are disarmed."""
        return self._now > 1000 and all(
            d.landed or (d.companion_lost and not self._autopilots.armed[d.index])
            for d in self._drones
            if d.name not in self._foreign
        )

    def _instant(self) -> None:
        """Do everything that happens in this very millisecond, always in the same order."""
        for drone in self._drones:
            self._exchange.instant(drone, self._now)
        if self._now % TELEMETRY_MS == 0:
            if self._pilots is not None:
                self._pilots.update(self._now / 1e3)
            self.truth.record(
                self._now / 1e3, self.vehicles, self._autopilots.armed, self._estimate()
            )

    def _estimate(self) -> Vector | None:
        """Return where the autopilots believe to be (n,3) m, where their state drifts."""
        if not self._drifts or not isinstance(self._autopilots, Autopilots):
            return None
        return self._autopilots.estimate

    def _next_event(self) -> int:
        """Return the next millisecond at which anything happens."""
        following = self._now + TELEMETRY_MS - self._now % TELEMETRY_MS
        return min(following, *(self._exchange.next_event(d, self._now) for d in self._drones))

    def _capture(
        self, drone: VehicleConnection, now: float, stamp: float, p: Vector, q: Vector
    ) -> Capture:
        """Return the frame that the drone's sensors deliver; see `exchange.Look`."""
        if isinstance(drone.frames, HostedFrames):
            drone.frames.look(now, stamp, p, q)
            return stamp, {}  # the frame stays in the process of its companion
        return captured(self.sensors, drone.camera, drone.index, now, stamp, p, q)

    def _idle_until(self, moment: float) -> None:
        """Deliver messages as they come in until `moment` [CLOCK_MONOTONIC, s]."""
        if isinstance(self._autopilots, RealFleet):  # their companions' messages pass us by
            time.sleep(max(moment - time.monotonic(), 0.0))
        while (left := moment - time.monotonic()) > 0.0:
            for drone in self._drones:
                self._exchange.deliver(drone, drone.companion, self._now)
            time.sleep(min(left, 0.002))

    # --- the end -------------------------------------------------------------------------

    def close(self) -> None:
        """End the companions and release the ports."""
        fleet = getattr(self, "_autopilots", None)
        if isinstance(fleet, RealFleet | LockstepFleet):
            fleet.close()
        for drone in getattr(self, "_drones", []):
            drone.close()
        for drone in getattr(self, "_drones", []):
            drone.end_process()
        if hasattr(self, "_exchange"):
            self._exchange.close()
        for host in getattr(self, "_hosts", []):
            host.close()

    def exit_codes(self) -> dict[str, int | None]:
        """Return how each companion ended, by drone name; negative: by that signal."""
        return {d.name: d.exit_code for d in self._drones}


@contextmanager
def flight(
    scenario: Scenario,
    folder: Path,
    real_time: bool = False,
    in_process: bool = False,
    hosts: int = 0,
) -> Iterator[Flight]:
    """Yield a flight whose processes and ports are released in every case; see `Flight`."""
    f = Flight(scenario, folder, real_time, in_process, hosts)
    try:
        yield f
    finally:
        f.close()
