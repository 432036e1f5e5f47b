"""Processes that each hold some companions of a flight, so that all cores work for it.

Only what crosses the wire passes: a frame and the MAVLink packets sent before it, an answer and the
packets that the companion sent. A companion ticks as it does in this process, and so the truth is
the same.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Answer, Frame
from sitl_sim.flight.in_process import InProcessCompanion, LocalFrames
from sitl_sim.scenarios.companion_entry_points import companion_class

_PATIENCE = 5.0  # s for a process to end by itself


class Host:
    """A process that holds companions; one request at a time. It starts with the first."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, self._theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(self._theirs,), daemon=True)
        self._lock = threading.Lock()

    def ask(self, what: str, name: str, *args: Any) -> Any:
        """Let the process do something for a companion; return what it returns.

        Raises:
            What it raises there; EOFError, OSError: the process has ended.
        """
        with self._lock:
            if self._process.pid is None:
                self._process.start()
                self._theirs.close()
            self._pipe.send((what, name, args))
            done, result = self._pipe.recv()
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


class HostedCompanion:
    """A companion in another process; called as one in this process."""

    def __init__(self, host: Host, config: Path, endpoint: MemoryEndpoint) -> None:
        """Build the companion of a configuration; its MAVLink link is `endpoint`."""
        self._host, self._name, self._endpoint = host, str(config), endpoint
        self._taken = 0  # packets
        host.ask("start", self._name)

    def answer(self, frame: Frame) -> Answer:
        """Let it tick on a frame and the packets sent before; return its answer."""
        # Later packets may wait, too: the flight goes on while the companion ticks.
        arrived = self._endpoint.receive()
        packets = [next(arrived) for _ in range(frame.packets - self._taken)]
        self._taken = frame.packets
        answer, sent = self._host.ask("tick", self._name, frame, packets)
        for packet in sent:
            self._endpoint.send(packet)
        return Answer(*answer)

    def close(self) -> None:
        """Finish the flight log, where its process still runs."""
        with contextlib.suppress(EOFError, OSError):
            self._host.ask("close", self._name)


class HostedFrames(LocalFrames):
    """As LocalFrames, with the companion in a process of `host`."""

    def __init__(self, host: Host) -> None:
        super().__init__()
        self._host = host

    def _made(self, config: Path, endpoint: MemoryEndpoint) -> InProcessCompanion:
        return HostedCompanion(self._host, config, endpoint)


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def _serve(pipe: Connection) -> None:
    """Hold companions until the other end closes the pipe."""
    import cv2

    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the flight's process decides when it is over
    held: dict[str, tuple[InProcessCompanion, MemoryEndpoint]] = {}
    actions: dict[str, Callable[..., Any]] = {"start": _start, "tick": _tick, "close": _close}
    while True:
        try:
            what, name, args = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            reply = True, actions[what](held, name, *args)
        except Exception as error:
            reply = False, _portable(error)
        pipe.send(reply)


def _portable(error: Exception) -> Exception:
    """Return the error, or its text where it cannot be sent."""
    text = "".join(traceback.format_exception(error))
    try:
        sent: Exception = pickle.loads(pickle.dumps(error))  # our own bytes
    except Exception:
        return RuntimeError(text)
    sent.add_note(text)
    return sent


def _start(held: dict[str, tuple[InProcessCompanion, MemoryEndpoint]], name: str) -> None:
    ours = MemoryEndpoint()
    held[name] = companion_class("in_process")(Path(name), MemoryEndpoint(ours)), ours


def _tick(
    held: dict[str, tuple[InProcessCompanion, MemoryEndpoint]],
    name: str,
    frame: Frame,
    packets: list[bytes],
) -> tuple[tuple[float, int, bool], list[bytes]]:
    companion, ours = held[name]
    for packet in packets:
        ours.send(packet)
    answer = companion.answer(frame)
    return (answer.time, answer.packets, answer.done), list(ours.receive())


def _close(held: dict[str, tuple[InProcessCompanion, MemoryEndpoint]], name: str) -> None:
    held.pop(name)[0].close()
