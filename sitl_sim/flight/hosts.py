"""Processes that each hold some companions of a flight, so that all cores work for it.

Their sensors are there, too: a picture is rendered in the process whose companion sees it, from the
poses of all drones, and crosses no pipe. A companion itself is given what crosses the wire and
nothing else: a frame and the MAVLink packets sent before it. It ticks as it does in the simulator's
own process, and so the truth is the same.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Answer, Frame
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.flight.garbage import spare_the_collector
from sitl_sim.flight.in_process import InProcessCompanion, LocalFrames, to_microseconds
from sitl_sim.flight.sensors import Capture, Sensors, captured
from sitl_sim.scenarios.companion_entry_points import companion_class
from sitl_sim.scenarios.scenario import Scenario

_PATIENCE = 5.0  # s for a process to end by itself


class Host:
    """A process that holds companions and their sensors, and does what is asked in that order."""

    def __init__(self, scenario: Scenario, world: dict[str, Any]) -> None:
        """Prepare the process, which builds the sensors of this scenario's drones itself."""
        context = multiprocessing.get_context("spawn")
        self._pipe, self._theirs = context.Pipe()
        args = (self._theirs, scenario, world)
        self._process = context.Process(target=_serve, args=args, daemon=True)
        self._replies: dict[str, tuple[bool, Any]] = {}  # that came before they were asked for

    def start(self) -> None:
        """Start the process; it takes seconds to be ready, in which this one may go on."""
        self._process.start()
        self._theirs.close()

    def post(self, what: str, name: str, *args: Any) -> None:
        """Ask the process to do something for a companion, and do not wait for it.

        Raises:
            OSError: the process has ended.
        """
        self._pipe.send((what, name, args))

    def reply(self, name: str) -> Any:
        """Wait for the reply to the last request for a companion that has one; return it.

        Raises:
            What was raised there; EOFError, OSError: the process has ended.
        """
        while name not in self._replies:
            sender, *reply = self._pipe.recv()
            self._replies[sender] = reply[0], reply[1]
        done, result = self._replies.pop(name)
        if not done:
            raise result
        return result

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        if self._process.pid is None:
            self._theirs.close()
            return
        self._process.join(_PATIENCE)
        if self._process.is_alive():
            self._process.kill()


class HostedFrames(LocalFrames):
    """As LocalFrames, with the companion and its sensors in a process of `host`."""

    def __init__(self, host: Host, i: int, camera: FaultyCamera) -> None:
        """Prepare the channel of drone i; camera: a copy of it alters what its sensors see."""
        super().__init__()
        self._host, self._i, self._camera = host, i, camera
        self._name = ""  # of the companion; empty where none runs
        self._endpoint = MemoryEndpoint()
        self._taken = 0  # packets

    def start_companion(self, config: Path, endpoint: MemoryEndpoint) -> None:
        """Start a companion of this configuration; its MAVLink link is `endpoint`."""
        self._error_log = config.with_name("stderr.log")
        self._endpoint = endpoint
        self._host.post("start", str(config), self._i, self._camera)
        self._host.reply(str(config))
        self._name = str(config)

    @property
    def connected(self) -> bool:
        """Tell whether a companion runs."""
        return bool(self._name)

    def look(self, now: float, stamp: float, p: Vector, q: Vector) -> None:
        """Let the drone's sensors look; the next frame sent holds what they see. See `captured`."""
        try:
            self._host.post("look", self._name, now, stamp, p, q)
        except OSError:
            self._lost()

    def send(self, frame: Frame) -> bool:
        """Let the companion tick on what its sensors saw last, and do not wait for its answer.

        frame: time and arrays are those of what was seen.
        """
        if not self.connected:
            return False
        # Later packets may wait, too, where the frame is of an earlier instant.
        arrived = self._endpoint.receive()
        packets = [next(arrived) for _ in range(frame.packets - self._taken)]
        self._taken = frame.packets
        try:
            self._host.post("tick", self._name, frame.packets, frame.due, packets)
        except OSError:
            self._lost()
        return not self.failed

    def answer(self, timeout: float) -> Answer | None:
        """Wait for the companion's answer, however long it takes; None where it is lost."""
        if not self.connected:
            return None
        try:
            answer, sent = self._host.reply(self._name)
        except Exception:
            self._lost()
            return None
        for packet in sent:
            self._endpoint.send(packet)
        return Answer(*answer)

    def close(self) -> None:
        """Finish the companion's log, where its process still runs."""
        name, self._name = self._name, ""
        if name:
            with contextlib.suppress(Exception):
                self._host.post("close", name)
                self._host.reply(name)

    hang_up = close


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass
class _Held:
    """A companion in its process; seen: what its sensors saw last, or why they could not."""

    companion: InProcessCompanion
    ours: MemoryEndpoint  # the vehicle's end of its link
    i: int
    camera: FaultyCamera
    seen: Capture | Exception


class _Companions:
    """The companions of a process, and the requests that they answer."""

    def __init__(self, sensors: Sensors) -> None:
        self._sensors = sensors
        self._held: dict[str, _Held] = {}

    def start(self, name: str, i: int, camera: FaultyCamera) -> None:
        """Build the companion of a configuration."""
        ours = MemoryEndpoint()
        companion = companion_class("in_process")(Path(name), MemoryEndpoint(ours))
        self._held[name] = _Held(companion, ours, i, camera, RuntimeError("nothing was seen"))
        spare_the_collector()

    def look(self, name: str, now: float, stamp: float, p: Vector, q: Vector) -> None:
        """Keep what the drone's sensors see now."""
        held = self._held[name]
        try:
            held.seen = captured(self._sensors, held.camera, held.i, now, stamp, p, q)
        except Exception as error:
            held.seen = error

    def tick(
        self, name: str, sent: int, due: float | None, packets: list[bytes]
    ) -> tuple[tuple[float, int, bool], list[bytes]]:
        """Let a companion tick; return its answer and the packets that it sent."""
        held = self._held[name]
        if isinstance(held.seen, Exception):
            raise held.seen
        for packet in packets:
            held.ours.send(packet)
        taken, arrays = held.seen
        due = None if due is None else to_microseconds(due)
        answer = held.companion.answer(Frame(to_microseconds(taken), arrays, sent, due))
        return (answer.time, answer.packets, answer.done), list(held.ours.receive())

    def close(self, name: str) -> None:
        """Finish a companion's log."""
        self._held.pop(name).companion.close()


def _serve(pipe: Connection, scenario: Scenario, world: dict[str, Any]) -> None:
    """Hold companions until the other end closes the pipe."""
    import cv2

    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the flight's process decides when it is over
    companions = _Companions(Sensors(scenario, world))
    replied: dict[str, Callable[..., Any]] = {
        "start": companions.start,
        "tick": companions.tick,
        "close": companions.close,
    }
    with contextlib.suppress(EOFError, OSError):
        while True:
            what, name, args = pipe.recv()
            if what == "look":  # without a reply: the next tick tells what was wrong
                companions.look(name, *args)
                continue
            try:
                reply = True, replied[what](name, *args)
            except Exception as error:
                reply = False, _portable(error)
            pipe.send((name, *reply))


def _portable(error: Exception) -> Exception:
    """Return the error, or its text where it cannot be sent."""
    text = "".join(traceback.format_exception(error))
    try:
        sent: Exception = pickle.loads(pickle.dumps(error))  # our own bytes
    except Exception:
        return RuntimeError(text)
    sent.add_note(text)
    return sent
