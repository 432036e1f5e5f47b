"""The simulator's connections to one vehicle's companion and ground stations."""

from __future__ import annotations

import subprocess
import sys
import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import ComponentId
from mavlink_bridge.wire.link import Endpoint, Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Received
from mavlink_bridge.wire.video import FrameServer
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.external.priority import COMPANION, raise_priority
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.catalogue import Schedule
from sitl_sim.faults.link import FaultyLine, FaultyLink, FaultyTelemetry
from sitl_sim.flight.in_process import LocalFrames
from sitl_sim.flight.sensors import Capture
from sitl_sim.flight.signed_lines import VehicleSigning

Ends = tuple[FrameServer | LocalFrames, Endpoint, Endpoint]
"""The simulator's ends of a vehicle's frame channel, companion's and ground stations' link."""


@dataclass
class VehicleConnection:
    """Links, frame channel and companion process of one vehicle.

    name, index: of the drone. boot_ms: what its clock shows when the flight begins [ms].
    """

    name: str
    index: int
    boot_ms: int
    companion: Link
    ground: Link
    frames: FrameServer | LocalFrames
    line: FaultyLine
    telemetry: FaultyTelemetry
    camera: FaultyCamera
    signing: VehicleSigning | None = None
    process: subprocess.Popen[bytes] | None = None
    capture: Future[Capture] | None = None  # the frame of the next tick
    delivery: Future[bool] | None = None  # that frame on its way to the companion
    due_ms: int | None = None  # when the answer to the delivered frame is sent
    hold_ms: int = 0  # how long its messages are then on their way to the vehicle
    held: deque[tuple[int, Received | bytes]] = field(
        default_factory=deque
    )  # by the time they arrive
    landed: bool = False
    companion_lost: bool = False  # the companion was connected and is gone

    @property
    def process_id(self) -> int | None:
        """Process id of the companion while it runs, else None."""
        return self.process.pid if self.process is not None and self._runs() else None

    @property
    def exit_code(self) -> int | None:
        """Exit code of the companion; negative: ended by that signal.

        Inside this process 1 where the companion raised, else None.
        """
        if isinstance(self.frames, LocalFrames):
            return 1 if self.frames.failed else None
        return self.process.returncode if self.process is not None else None

    def launch(self, folder: Path, urgent: bool) -> None:
        """Start the companion of `folder`/config.yaml; urgent: with real-time priority."""
        config = folder / "config.yaml"
        if isinstance(self.frames, LocalFrames):
            end = self.companion.endpoint
            assert isinstance(end, MemoryEndpoint)
            self.frames.start_companion(config, MemoryEndpoint(end))
            return
        with (folder / "stderr.log").open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "companion", "run", str(config)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        if urgent:
            raise_priority(COMPANION, self.process.pid)

    def ready(self, folder: Path, deadline: float) -> bool:
        """Return whether the launched companion is connected; deadline: CLOCK_MONOTONIC [s].

        Raises:
            RuntimeError: the companion ended (with the end of its output), or time ran out.
        """
        if self.process is None or self.frames.connected:
            return True
        if not self._runs():
            log = folder / "stderr.log"
            tail = log.read_text(errors="replace").strip().splitlines()[-3:]
            raise RuntimeError(f"{self.name}: companion ended: " + " | ".join(tail))
        if time.monotonic() > deadline:
            raise RuntimeError(f"{self.name}: companion did not connect in time")
        return False

    def silent(self, deadline: float) -> bool:
        """Return whether no answer can be expected any longer; deadline as for `ready`."""
        gone = self.process is not None and not self._runs()
        return gone or not self.frames.connected or time.monotonic() > deadline

    def relay_telemetry(self, fleet: LockstepFleet) -> None:
        """Pass on what the real autopilot has sent to its companion and to ground stations."""
        self.companion.send_packets(fleet.packets(self.index, "companion"))
        self.ground.send_packets(fleet.packets(self.index, "gcs"))

    def route(self) -> None:
        """Pass messages on between companion and ground stations, as a router on the board does.

        The companion is sent what names it, and a ground station that speaks what is not for the
        autopilot alone.
        """
        reader = Codec(255, ComponentId.AUTOPILOT1)

        def to_ground(sent: bool, data: bytes) -> None:
            if sent or not self.ground.packets_in:
                return
            if any(t != ComponentId.AUTOPILOT1 for t in _targets(reader, data)):
                self.ground.send_packets([data])

        def to_companion(sent: bool, data: bytes) -> None:
            if not sent and max(_targets(reader, data), default=0) > ComponentId.AUTOPILOT1:
                self.companion.send_packets([data])

        self.companion.tap, self.ground.tap = to_ground, to_companion

    def drop_companion(self) -> None:
        """Stop waiting for a companion that does not answer; it is sent no more frames."""
        self.companion_lost = True
        self.frames.hang_up()

    def close(self) -> None:
        """Release the ports: the companion then ends."""
        self.frames.close()
        self.companion.close()
        self.ground.close()

    def end_process(self) -> None:
        """Let the companion finish its log; terminate it where it does not end."""
        if self.process is None:
            return
        try:
            self.process.wait(timeout=0.5)
        except subprocess.TimeoutExpired:
            self.process.terminate()
            try:
                self.process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def _runs(self) -> bool:
        return self.process is not None and self.process.poll() is None


def connect(
    name: str,
    index: int,
    boot_ms: int,
    ends: Ends,
    camera: FaultyCamera,
    schedule: Schedule,
    key: bytes | None,
) -> VehicleConnection:
    """Return the connections of a vehicle, with the faults that are scheduled for its lines.

    name, index, boot_ms: as for `VehicleConnection`. key: with which both links sign; None: they
    do not.
    """
    frames, companion, ground = ends
    system = index + 1
    line = FaultyLine(schedule, index)
    signing = VehicleSigning(key) if key is not None else None
    return VehicleConnection(
        name,
        index,
        boot_ms,
        FaultyLink(
            companion, Codec(system, 1, signing=signing.companion if signing else None), line
        ),
        Link(ground, Codec(system, 1, signing=signing.ground if signing else None)),
        frames,
        line,
        FaultyTelemetry(schedule, index),
        camera,
        signing,
    )


def _targets(reader: Codec, data: bytes) -> list[int]:
    """Return the component that each message of a packet is for; 0: all."""
    messages = [r.message for r in reader.decode_datagram(data)]
    return [int(getattr(m, "target_component", 0)) for m in messages]
