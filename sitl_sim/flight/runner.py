"""One flight: the world, its vehicles, and N companions: processes on the wire, or in this one.

Lockstep: the world advances only to the instant at which an answer is due; frames of
different drones are rendered, and companions think, meanwhile and side by side. Real time:
nobody waits for anybody.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Endpoint, Link, UdpEndpoint
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Frame, FrameServer
from sitl_sim.external.fleet import RealFleet, Wire
from sitl_sim.faults import catalogue as faults
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.link import FaultyLine, FaultyLink, FaultyTelemetry
from sitl_sim.faults.world import FaultyWorld
from sitl_sim.flight.in_process import AtOnce, LocalFrames
from sitl_sim.flight.own_binary import boot_parameters, own_binary
from sitl_sim.flight.sensors import Eyes
from sitl_sim.flight.station import Shot, Station
from sitl_sim.recording.run_folder import forget, remove
from sitl_sim.recording.truth import Truth
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import check_companions, companion_config, companion_port
from sitl_sim.scenarios.scenario import QUANTUM_MS, TICK_MS, Scenario
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Airframe, Vehicles
from sitl_sim.worlds.generators import build

_TELEMETRY_MS = 20
_CONNECT_TIMEOUT = 60.0


class Flight:
    """Builds the world and the wire; `run` flies.

    Raises:
        EndpointError, VideoError: a port is in use, named.
        SettingsError: what this scenario, or a companion of it, cannot have.
    """

    def __init__(
        self, scenario: Scenario, folder: Path, real_time: bool = False, in_process: bool = False,
        anew: bool = False,
    ) -> None:  # fmt: skip
        """anew: a folder that is there already is deleted, once the ports are ours."""
        self.scenario = scenario
        self.folder = folder
        self._in_process = in_process
        self.names = scenarios.drone_names(scenario)
        self._schedule = scenarios.fault_schedule(scenario)
        faults.check(scenario.faults, processes=not in_process)
        check_companions(scenario, in_process)
        start = scenarios.starts(scenario)
        self._yaws = scenarios.frame_yaws(scenario)
        self.targets = scenarios.targets(scenario, start)
        self.world = {"drone_radius": scenario.drones.radius,
                      **build(scenario.world, scenario.seed),
                      "targets": self.targets,
                      "target_tolerance": scenario.mission.tolerance}  # fmt: skip
        heading = scenarios.headings(scenario, start)
        self.vehicles = Vehicles(Airframe(), start, heading)
        phases = scenarios.boot_ms(scenario)
        self.eyes = Eyes(scenario, self.world)
        self._start = start
        self._real_time = real_time or scenario.drones.real
        self._drones: list[Station] = []
        for i, name in enumerate(self.names):
            self._drones.append(self._open(i, name, phases[i]))
        # Whoever flies into this folder now has these ports: it is not touched before.
        try:
            if anew:
                remove(folder)
            self._autopilots = self._switch_on(phases)
        except BaseException:
            self.close()
            raise
        emulated = None if isinstance(self._autopilots, RealFleet) else self._autopilots
        self._faults = FaultyWorld(
            self._schedule, self.vehicles, emulated,
            lambda i: self._drones[i].process_id, self._rebooted,
        )  # fmt: skip
        # Threads pay where there is something to render, and where nobody may be waited for.
        at_once = in_process or not (self._real_time or self.eyes.renders)
        self._pool: Executor = (
            # Deliveries wait for captures that were submitted before them, so not all can wait.
            AtOnce() if at_once else ThreadPoolExecutor(max_workers=2 * (os.cpu_count() or 1))
        )
        self._latency_ms = round(scenario.sensing.latency * 1e3 / QUANTUM_MS) * QUANTUM_MS
        self.truth = Truth(self.names)
        self.wall_seconds = 0.0
        self._now = 0

    # --- setting up ----------------------------------------------------------------------

    def _switch_on(self, phases: list[int]) -> Autopilots | RealFleet:
        """The vehicles' autopilots: emulated, or real ones on our physics."""
        s, systems = self.scenario, list(range(1, len(self.names) + 1))
        if s.drones.real:
            w = s.wire
            folders = [self.folder / "drones" / name for name in self.names]
            wires = [Wire(w.host, companion_port(w, k), w.gcs_port) for k in systems]
            return RealFleet(
                self.vehicles,
                systems,
                folders,
                wires,
                origin=self._start,
                yaw_offset=self._yaws,
                seed=s.seed,
                program=own_binary(s.drones, folders, wires) if s.drones.binary else None,
            )
        return Autopilots(
            self.vehicles,
            systems,
            s.drones.autopilot,
            origin=self._start,
            yaw_offset=self._yaws,
            boot_offset=np.array(phases) / 1e3,
            seed=s.seed,
            parameters=boot_parameters(s.drones),
        )

    def _open(self, i: int, name: str, boot_ms: int) -> Station:
        system = i + 1
        frames, companion, ground = self._wire(system)
        line = FaultyLine(self._schedule, i)
        return Station(
            name, i, boot_ms,
            FaultyLink(companion, Codec(system, 1), line), Link(ground, Codec(system, 1)), frames,
            line, FaultyTelemetry(self._schedule, i), FaultyCamera(self._schedule, i),
        )  # fmt: skip

    def _wire(self, system: int) -> tuple[FrameServer | LocalFrames, Endpoint, Endpoint]:
        """A vehicle's end of the frame channel, of the companion's and of the ground's link."""
        if self._in_process:
            return LocalFrames(), MemoryEndpoint(), MemoryEndpoint()
        wire, patience = self.scenario.wire, self.scenario.timing.answer_timeout
        try:
            return (
                FrameServer(wire.host, wire.frame_port + system, patience, not self._real_time),
                UdpEndpoint(remote=(wire.host, companion_port(wire, system))),
                UdpEndpoint(remote=(wire.host, wire.gcs_port)),
            )
        except (OSError, ValueError):
            self.close()
            raise

    def _rebooted(self, i: int) -> None:
        """Drone i's clock begins anew; its camera stamps by it."""
        self._drones[i].boot_ms = -self._now

    def wire_table(self) -> list[str]:
        """Where each vehicle listens and speaks, a line each."""
        if self._in_process:
            return []
        w = self.scenario.wire
        return [
            f"{d.name}: system {d.index + 1}, companion UDP {companion_port(w, d.index + 1)}, "
            f"frames TCP {w.frame_port + d.index + 1}, ground station UDP {w.gcs_port}"
            for d in self._drones
        ]

    def write_inputs(self) -> None:
        """Run folder: the resolved scenario, the world, and each companion's config.

        Raises:
            SettingsError: there can be no such folder.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            forget(self.folder)
        except OSError as error:
            raise SettingsError([f"{self.folder}: no run folder: {error.strerror}"]) from error
        text = yaml.safe_dump(self.scenario.model_dump(by_alias=True), sort_keys=False)
        (self.folder / "scenario.yaml").write_text(text, encoding="utf-8")
        world = json.dumps(self.world, indent=1)
        (self.folder / "world.json").write_text(world, encoding="utf-8")
        for drone in self._drones:
            folder = self.folder / "drones" / drone.name
            folder.mkdir(parents=True, exist_ok=True)
            config = yaml.safe_dump(self.companion_config(drone.index), sort_keys=False)
            (folder / "config.yaml").write_text(config, encoding="utf-8")

    def companion_config(self, i: int) -> dict[str, Any]:
        """What drone i is told."""
        return companion_config(self.scenario, i, self.folder, clock=self._real_time)

    def launch(self) -> None:
        """Start a companion for each drone."""
        urgent = isinstance(self._autopilots, RealFleet)
        for drone in self._drones:
            drone.launch(self.folder / "drones" / drone.name, urgent)

    def wait_for_companions(self) -> None:
        """Until every launched companion is on its frame channel.

        Raises:
            RuntimeError: one ended, with the end of what it printed; or time ran out.
        """
        deadline = time.monotonic() + _CONNECT_TIMEOUT
        for drone in self._drones:
            drone.wait(self.folder / "drones" / drone.name, deadline)

    # --- flying --------------------------------------------------------------------------

    def run(self, progress: Callable[[float], None] = lambda t: None) -> None:
        """Fly until every companion has landed, or the time limit."""
        limit = round(self.scenario.mission.time_limit * 1e3)
        started = time.monotonic()
        if isinstance(self._autopilots, RealFleet):
            self._autopilots.begin(started)
            for drone in self._drones:  # their clock is CLOCK_MONOTONIC
                drone.boot_ms = round(started * 1e3)
        earliest = started
        while self._now < limit and not self._over():
            if self._real_time:
                self._idle_until(max(started + self._now / 1e3, earliest))
            self._instant()
            following = self._next_event()
            # A world that was held up catches up at twice its pace, no faster: to a vehicle that
            # lives a second at once, everybody is silent for a second.
            earliest = time.monotonic() + (following - self._now) / 2e3
            self._faults.update(self._now / 1e3)
            wind = self._faults.wind(self._now / 1e3, np.array(self.scenario.wind))
            self._autopilots.advance(following / 1e3, wind)
            self._now = following
            progress(self._now / 1e3)
        self.wall_seconds = time.monotonic() - started

    def _over(self) -> bool:
        """All have landed, or are gone and their vehicles are on the ground."""
        return self._now > 1000 and all(
            d.landed or (d.deaf and not self._autopilots.armed[d.index]) for d in self._drones
        )

    def _instant(self) -> None:
        """Everything that happens at this very millisecond, always in the same order."""
        for drone in self._drones:
            drone.line.now = self._now / 1e3
            if drone.due_ms is not None and drone.due_ms <= self._now:
                self._take_answer(drone)
            if self._real_time:
                self._deliver(drone, drone.companion)
            boot = self._now + drone.boot_ms
            if boot % _TELEMETRY_MS == 0:
                self._deliver(drone, drone.ground)
                self._speak(drone)
            if (boot + self._latency_ms) % TICK_MS == 0:
                self._capture(drone)
            if boot % TICK_MS == 0:
                self._show(drone)
        if self._now % _TELEMETRY_MS == 0:
            self.truth.record(self._now / 1e3, self.vehicles, self._autopilots.armed)

    def _next_event(self) -> int:
        """The next millisecond at which anything happens."""
        following = self._now + _TELEMETRY_MS - self._now % _TELEMETRY_MS
        real = isinstance(self._autopilots, RealFleet)  # they speak for themselves
        for drone in self._drones:
            boot = self._now + drone.boot_ms
            period = TICK_MS if real else _TELEMETRY_MS
            following = min(
                following,
                self._now + period - boot % period,
                self._now + TICK_MS - (boot + self._latency_ms) % TICK_MS,
            )
            if drone.due_ms is not None and not real:
                following = min(following, max(drone.due_ms, self._now + QUANTUM_MS))
        return following

    def _speak(self, drone: Station) -> None:
        """Telemetry that is due, on both links."""
        told = self._autopilots.telemetry(drone.index, "companion")
        drone.companion.send(drone.telemetry.alter(self._now / 1e3, told))
        nobody = not drone.ground.packets_in
        drone.ground.send(self._autopilots.telemetry(drone.index, "gcs", quiet=nobody))

    def _deliver(self, drone: Station, link: Link) -> None:
        """Messages that wait on a link, to the vehicle; its replies back at once."""
        name = "companion" if link is drone.companion else "gcs"
        for received in link.receive():
            link.send(self._autopilots.receive(drone.index, received, name))

    def _capture(self, drone: Station) -> None:
        """Start painting what drone sees at this instant."""
        if not drone.frames.connected:
            drone.deaf |= drone.process is not None
            return
        if drone.delivery is not None and not drone.delivery.done() and self._real_time:
            return  # the last frame is still under way, this one is dropped
        stamp, now = (self._now + drone.boot_ms) / 1e3, self._now / 1e3
        p, q = self.vehicles.p.copy(), self.vehicles.q.copy()
        drone.capture = self._pool.submit(self._shoot, drone, now, stamp, p, q)

    def _shoot(self, drone: Station, now: float, stamp: float, p: Vector, q: Vector) -> Shot:
        return drone.camera.see(now, stamp, self.eyes.see(drone.index, stamp, p, q))

    def _show(self, drone: Station) -> None:
        """Deliver the frame that was taken for this instant; its tick falls due."""
        if drone.capture is None or drone.due_ms is not None:
            return  # none was taken, or its companion is still busy with the last one
        stamp, now = (self._now + drone.boot_ms) / 1e3, self._now / 1e3
        packets = drone.companion.packets_out
        drone.delivery = self._pool.submit(self._send_frame, drone, drone.capture, packets, stamp)
        drone.capture = None
        paused = sum(f.value for f in self._schedule.at(drone.index, now, "pause"))
        drone.due_ms = self._now + round((self.scenario.timing.compute_delay + paused) * 1e3)

    @staticmethod
    def _send_frame(drone: Station, capture: Future[Shot], packets: int, due: float) -> bool:
        taken, arrays = capture.result()
        return drone.frames.send(Frame(taken, arrays, packets, due=due))

    def _take_answer(self, drone: Station) -> None:
        """Wait for the answer that is due and let what was sent take effect."""
        drone.due_ms = None
        if self._real_time:
            while (late := drone.frames.answer(0.0)) is not None:
                drone.landed |= late.done
            return
        if drone.delivery is None or not drone.delivery.result():
            drone.lose()
            return
        deadline = time.monotonic() + self.scenario.timing.answer_timeout  # painting not counted
        while True:
            answer = drone.frames.answer(0.2)
            if answer is not None:
                break
            if drone.lost(deadline):
                drone.lose()
                return
        drone.landed |= answer.done
        while drone.companion.packets_in < answer.packets and time.monotonic() < deadline:
            self._deliver(drone, drone.companion)
            if drone.companion.packets_in < answer.packets:
                drone.companion.wait(0.05)
        self._deliver(drone, drone.companion)

    def _idle_until(self, moment: float) -> None:
        """Real time: deliver what comes in until `moment` [CLOCK_MONOTONIC]."""
        if isinstance(self._autopilots, RealFleet):  # their companions' messages pass us by
            time.sleep(max(moment - time.monotonic(), 0.0))
        while (left := moment - time.monotonic()) > 0.0:
            for drone in self._drones:
                self._deliver(drone, drone.companion)
            time.sleep(min(left, 0.002))

    # --- the end -------------------------------------------------------------------------

    def close(self) -> None:
        """End the companions, release the ports."""
        fleet = getattr(self, "_autopilots", None)
        if isinstance(fleet, RealFleet):
            fleet.close()
        for drone in getattr(self, "_drones", []):
            drone.close()
        for drone in getattr(self, "_drones", []):
            drone.end()
        if hasattr(self, "_pool"):
            self._pool.shutdown(wait=True, cancel_futures=True)

    @property
    def processes(self) -> dict[str, subprocess.Popen[bytes]]:
        """The companions launched, by drone."""
        return {d.name: d.process for d in self._drones if d.process is not None}

    def exit_codes(self) -> dict[str, int | None]:
        """How each companion ended; negative: by that signal."""
        return {d.name: d.exit_code for d in self._drones}


@contextmanager
def flight(
    scenario: Scenario, folder: Path, real_time: bool = False, in_process: bool = False,
    anew: bool = False,
) -> Iterator[Flight]:  # fmt: skip
    """A flight whose processes and ports are released whatever happens."""
    f = Flight(scenario, folder, real_time, in_process, anew)
    try:
        yield f
    finally:
        f.close()
