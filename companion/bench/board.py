"""A board's verdict: is it fast enough for a companion, and if not, which setting makes it so?

The bench sends pictures of a drawn scene through the configured eyes, flies the packaged flight
through all other stages, and measures memory and start of a process. The times are those of this
machine as it is now: other work on it counts, as it will in flight.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from companion.bench.tick import WHOLE, stage_costs, stored
from companion.perception.camera import CalibrationError
from companion.perception.frontend import PerceptionFrontend, make_view
from companion.settings.config import CompanionConfig
from companion.types import Image
from mavlink_bridge.shared.settings import assignments, merge, parse_yaml, validate
from mavlink_bridge.wire.messages import VehicleState
from mavlink_bridge.wire.video import Frame

FITS, TIGHT = 0.5, 0.8  # of the period, at p99: `companion doctor` has the same limits
_PICTURES = 60
_SPEED = 1.5  # m/s
_PERIOD = 0.1  # s between two pictures
# Settings that take less time, and their price in flight; tried in turn until a tick fits.
LOWER = (
    (("sensing.parallax=false",), "nothing but colour shows obstacles"),
    (("sensing.parallax=false", "sensing.trunks_every=3"), "trunks are looked for less often"),
    (
        ("sensing.parallax=false", "camera.width=320", "camera.height=200"),
        "drones and trunks are seen at half the distance",
    ),
)


@dataclass(frozen=True)
class Board:
    """The figures of one board.

    see, rest: ms, p50 and p99 of the eyes, and of all other stages. period: ms. memory: MB. start:
    s, until a companion is built.
    """

    see: tuple[float, float]
    rest: tuple[float, float]
    period: float
    memory: float
    start: float

    @property
    def tick(self) -> float:
        """p99 of a whole tick [ms], both at their worst."""
        return self.see[1] + self.rest[1]

    @property
    def verdict(self) -> str:
        """Say whether a tick fits into its period."""
        share = self.tick / self.period
        return "fits" if share <= FITS else "tight" if share <= TIGHT else "does not fit"


def measure(config: CompanionConfig) -> Board:
    """Measure this machine with a drone's configuration.

    Raises:
        CalibrationError, ModelError: a file that the eyes need cannot be used.
    """
    start, memory = _started(config)
    see = _quantiles(list(_seen(config)))
    costs = stage_costs(stored())
    rest = costs[WHOLE]["p50"], costs[WHOLE]["p99"]
    return Board(see, rest, config.timing.period * 1e3, memory, start)


def cheaper(config: CompanionConfig, board: Board) -> tuple[tuple[str, ...], str, Board] | None:
    """Return the first settings with which a tick fits, their price, and the board with them."""
    for settings, price in LOWER:
        given = parse_yaml(config.model_dump_json(exclude_unset=True), "the configuration")
        document = merge([given, assignments(list(settings))])
        lower = validate(CompanionConfig, document, "lowered settings")
        try:
            found = replace(board, see=_quantiles(list(_seen(lower))))
        except CalibrationError:  # the camera is calibrated for another size of its pictures
            continue
        if found.verdict == "fits":
            return settings, price, found
    return None


def _seen(config: CompanionConfig) -> Iterator[float]:
    """Yield the time [s] that each picture takes, flown through a drawn scene."""
    view = make_view(config.camera, config.sensing)
    eyes = PerceptionFrontend(view, config.sensing, config.camera_health)
    scene = _Scene(config.camera.width, config.camera.height)
    still = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))

    def at(when: float) -> VehicleState:
        place = np.array([_SPEED * when, 0.0, 2.0])
        return replace(still, time=when, p=place, v=np.array([_SPEED, 0.0, 0.0]))

    for n in range(_PICTURES):
        when = 1.0 + n * _PERIOD
        frame = Frame(when, {"image": scene.picture(n)})
        began = time.perf_counter()
        eyes.see(when, frame, at)
        yield time.perf_counter() - began


class _Scene:
    """Sky, textured ground, four trunks and three drones with balls, which grow as one flies."""

    def __init__(self, width: int, height: int) -> None:
        self._size = width, height
        self._rng = np.random.default_rng(0)
        grain = self._rng.integers(0, 60, (height // 4, width // 4), dtype=np.uint8)
        self._texture = cv2.resize(grain, self._size, interpolation=cv2.INTER_LINEAR)

    def picture(self, n: int) -> Image:
        """Return picture n (height,width,3) uint8 BGR."""
        width, height = self._size
        image = np.zeros((height, width, 3), np.uint8)
        image[: height // 2] = (225, 200, 175)
        texture = np.roll(self._texture, n, axis=0)[height // 2 :, :, None]
        image[height // 2 :] = np.array([40, 90, 80], np.uint8) + texture
        for k in range(4):
            near = 1.0 + ((n + 15 * k) % 60) / 20.0
            middle, wide = int(width * (0.15 + 0.23 * k)), int(width * 0.02 * near)
            bark = (self._texture[:, :1] // 2 + 70).astype(np.uint8)
            foot = height // 2 + int(0.1 * height * near)
            image[:foot, middle - wide : middle + wide] = bark[:foot, :, None]
        for k in range(3):
            place = (int(width * (0.25 + 0.25 * k)), int(height * 0.45))
            cv2.circle(image, place, 3 + (n // 6 + 3 * k) % 12, (230, 40, 230), -1)
        noise = self._rng.integers(0, 8, image.shape, dtype=np.uint8)
        return cv2.add(image, noise)  # type: ignore[return-value]


_BUILT = """
import re, sys, time
from companion.pipeline import Companion
from companion.process import daemon
from companion.settings.config import CompanionConfig
Companion(CompanionConfig.model_validate_json(sys.stdin.read()), time.perf_counter)
print(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])
"""


def _started(config: CompanionConfig) -> tuple[float, float]:
    """Return the time [s] in which a process builds a companion, and its memory then [MB]."""
    began = time.perf_counter()
    given = config.model_dump_json(exclude_unset=True)
    command = [sys.executable, "-c", _BUILT]
    done = subprocess.run(command, input=given, text=True, capture_output=True, check=True)
    return time.perf_counter() - began, float(done.stdout) / 1e3


def _quantiles(taken: list[float]) -> tuple[float, float]:
    p50, p99 = np.percentile(taken, [50, 99]) * 1e3
    return float(p50), float(p99)
