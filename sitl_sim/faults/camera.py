"""Faults of one drone's camera, and of a perfect detector's reports."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sitl_sim.faults.catalogue import Fault, Schedule

Arrays = dict[str, NDArray[Any]]
_KEPT = 60  # frames, six seconds: the longest delay
_GHOST_RANGE = (1.5, 8.0)  # m


class FaultyCamera:
    """Alters the frames of drone i; one call for each frame, in order."""

    def __init__(self, schedule: Schedule, i: int) -> None:
        self._schedule, self._i = schedule, i
        self._taken: deque[tuple[float, Arrays]] = deque(maxlen=_KEPT)
        self._frozen: Arrays | None = None

    def alter(self, now: float, stamp: float, arrays: Arrays) -> tuple[float, Arrays]:
        """Return capture time and arrays of the frame that is sent at `now` [s of the flight].

        stamp: now on the vehicle's clock [s].
        """
        arrays = self._report(now, arrays)
        self._taken.append((stamp, arrays))
        if self._at(now, "camera_dead"):
            return stamp, {}
        if late := self._at(now, "camera_late"):
            due = [t for t in self._taken if t[0] <= stamp - late[0].value]
            stamp, arrays = due[-1] if due else self._taken[0]
        if self._at(now, "camera_frozen"):
            before = self._taken[-2][1] if len(self._taken) > 1 else arrays
            self._frozen = self._frozen or before
            arrays = self._frozen
        else:
            self._frozen = None
        for kind, level in (("camera_black", 0), ("camera_saturated", 255)):
            if self._at(now, kind) and "image" in arrays:
                arrays = arrays | {"image": np.full_like(arrays["image"], level)}
        return stamp, arrays

    def _report(self, now: float, arrays: Arrays) -> Arrays:
        """Alter a perfect detector's report."""
        rows = arrays.get("neighbours")
        if rows is None:
            return arrays
        for fault in self._at(now, "range_bias"):
            rows = rows * np.array([1, 1, 1, fault.value, 1, 1])
        for fault in self._at(now, "missed"):
            rows = rows[[not fault.strikes() for _ in rows]]
        for fault in self._at(now, "swaps"):
            rows = fault.rng.permutation(rows) if fault.strikes() else rows
        for fault in self._at(now, "ghosts"):
            rows = np.vstack([rows, _ghost(fault.rng)]) if fault.strikes() else rows
        return arrays | {"neighbours": rows}

    def _at(self, now: float, kind: str) -> list[Fault]:
        return self._schedule.at(self._i, now, kind)


def _ghost(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a report (6,) of a neighbour ahead that does not exist."""
    angle = rng.uniform(-1.0, 1.0)
    ray = [np.sin(angle), 0.0, np.cos(angle)]
    return np.array([*ray, rng.uniform(*_GHOST_RANGE), 0.005, 0.03])
