"""A user's own SITL binary on the simulator's physics: the common part of ArduPilot and PX4.

Motion is sent and motor commands are received some 500 times a second, as in `betaflight_sitl`;
telemetry goes from the binary straight to the companion. Both number their motors: front right,
rear left, front left, rear right.
"""

from __future__ import annotations

import os
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sitl_sim.external.priority import AUTOPILOT, raise_priority

if TYPE_CHECKING:
    from sitl_sim.vehicles.rigid_body import State
    from sitl_sim.worlds.geodesy import LocalFrame

_BOOT = 30.0  # s until motor commands come
_OURS = [3, 0, 1, 2]  # indices of rear right, front right, rear left, front left


class ExternalError(RuntimeError):
    """An autopilot cannot be run, or sends nothing; the message says which and why."""


class ExternalSitl(ABC):
    """One process with its folder; command: its newest motor commands (4,) 0…1, our order."""

    def __init__(
        self, command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None
    ) -> None:
        """Start `command` in `folder`, which takes its settings and its output."""
        self.command = np.zeros(4)
        self._folder, self._name, self._heard = folder, command[0], False
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with (folder / "output.log").open("wb") as log:
                self._process = subprocess.Popen(
                    command,
                    cwd=folder,
                    env=os.environ | (environment or {}),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
        except OSError as error:
            raise ExternalError(f"{command[0]}: cannot be run: {error.strerror}") from error
        raise_priority(AUTOPILOT, self._process.pid)

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def await_boot(self) -> None:
        """Wait for the first motor commands; `exchange` must already be called meanwhile.

        Raises:
            ExternalError: the process ended, or sent nothing in time.
        """
        end = time.monotonic() + _BOOT
        while not self._heard:
            if not self.alive or time.monotonic() > end:
                why = "sends no motor commands" if self.alive else "ended"
                raise ExternalError(f"{self._name} {why}; see {self._folder}/output.log")
            time.sleep(0.05)

    @abstractmethod
    def exchange(self, i: int, state: State, frame: LocalFrame) -> NDArray[np.float64]:
        """Send the motion of vehicle i now; return its newest motor commands (4,) 0…1."""

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

    def _set_motors(self, motors: Sequence[float]) -> None:
        """Take motor commands 0…1 in the binary's order."""
        self.command = np.clip(np.array(motors[:4])[_OURS], 0.0, 1.0)
        self._heard = True
