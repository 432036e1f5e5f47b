"""A user's own SITL binary on the simulator's physics: the common part of ArduPilot and PX4.

Both wait for the motion of their vehicle at each step and answer with motor commands, so that
their time advances with the simulator's alone. Both number their motors: front right, rear left,
front left, rear right.
"""

from __future__ import annotations

import os
import socket
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sitl_sim.external.autopilot_link import AutopilotLink

if TYPE_CHECKING:
    from sitl_sim.vehicles.rigid_body import State

_OURS = [3, 0, 1, 2]  # indices of rear right, front right, rear left, front left
_ENDS = 3.0  # s for a process to end by itself


class ExternalError(RuntimeError):
    """An autopilot cannot be run, or sends nothing; the message says which and why."""


class ExternalSitl(ABC):
    """One process with its folder.

    command: its newest motor commands (4,) 0…1, our order. links: its MAVLink links, `companion`
    and `gcs`. clock: its time_boot is the time of `send` plus this [s].

    Class attribute: period: s between two steps.
    """

    period: ClassVar[float]
    links: Mapping[str, AutopilotLink]

    def __init__(self, folder: Path) -> None:
        """folder: takes its settings and its output."""
        self.command = np.zeros(4)
        self.folder = folder
        self.name = ""
        self._process: subprocess.Popen[bytes] | None = None

    def run(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        """Start `command` in the folder.

        Raises:
            ExternalError: the program cannot be run.
        """
        self.name = Path(command[0]).name
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            with (self.folder / "output.log").open("ab") as log:
                self._process = subprocess.Popen(
                    command,
                    cwd=self.folder,
                    env=os.environ | (environment or {}),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # Ctrl-C is the simulator's: it ends its autopilots
                )
        except OSError as error:
            raise ExternalError(f"{command[0]}: cannot be run: {error.strerror}") from error

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    @property
    def process_id(self) -> int:
        """Process id of the autopilot."""
        assert self._process is not None
        return self._process.pid

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Whether it takes the motion of its vehicle."""

    @abstractmethod
    def send(self, time: float, i: int, state: State) -> None:
        """Send the motion of vehicle i at `time` [s since its start], where a step is awaited."""

    @abstractmethod
    def receive(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for the motor commands of the step; return whether they came."""

    def close(self) -> None:
        """End the process and release the ports, also where a signal interrupts that."""
        with ExitStack() as stack:
            for link in self.links.values():
                stack.callback(link.close)
            if self._process is not None:
                stack.callback(self._process.wait)
                # ArduCopter waits for the simulator and hears no signal meanwhile.
                stack.callback(self._process.kill)
                self._process.terminate()
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(timeout=_ENDS)

    def _set_motors(self, motors: Sequence[float]) -> None:
        """Take motor commands 0…1 in the binary's order."""
        self.command = np.clip(np.array(motors[:4])[_OURS], 0.0, 1.0)


def udp_free(port: int) -> bool:
    """Return whether no other program listens on this UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        try:
            s.bind(("", port))
        except OSError:
            return False
    return True
