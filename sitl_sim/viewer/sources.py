"""Sources of the flight that a page shows: a run folder, or a flight under way."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import orjson

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.mcap_file import Follower
from sitl_sim.figures.belief import Belief, Beliefs, belief_of
from sitl_sim.figures.events import Event, events
from sitl_sim.recording.run_folder import Run, log_path, own_frames
from sitl_sim.scenarios.scenario import Scenario, drone_names


@dataclass(frozen=True)
class Moment:
    """The swarm at `time` [s]: p (N,3) m, q (N,4), and the last seconds' paths (N,K,3) m."""

    time: float
    p: Vector
    q: Vector
    trail: Vector


class Source(Protocol):
    """A flight that can be shown."""

    scenario: Scenario
    world: dict[str, Any]
    names: list[str]
    live: bool

    @property
    def duration(self) -> float:
        """Time up to which the flight can be shown [s]."""
        ...

    def events(self) -> list[Event]:
        """Return what has happened, in order of time."""
        ...

    def moment(self, time: float) -> Moment:
        """Return the truth at a time [s]."""
        ...

    def belief(self, drone: int, time: float) -> Belief | None:
        """Return what a companion believed at a time [s]."""
        ...


_TRAIL, _TRAIL_STEP = 8.0, 0.2  # s


class Replay:
    """A recorded flight."""

    live = False

    def __init__(self, run: Run) -> None:
        self.scenario, self.world, self.names = run.scenario, run.world, run.names
        self._t = run.truth["t"]
        self._p, self._q = (run.truth[k].astype(float) for k in ("position", "attitude"))
        self._beliefs = Beliefs(run)
        self._events = events(run)

    def events(self) -> list[Event]:
        """Return all events of the flight."""
        return self._events

    @property
    def duration(self) -> float:
        """Time of the last recorded instant [s]."""
        return float(self._t[-1])

    def moment(self, time: float) -> Moment:
        """Return the recorded instant at or after `time`."""
        k = min(int(np.searchsorted(self._t, time - 1e-9)), len(self._t) - 1)
        return Moment(float(self._t[k]), self._p[k], self._q[k], self._trail(time))

    def belief(self, drone: int, time: float) -> Belief | None:
        """Return the belief at the last tick before `time`."""
        return self._beliefs.at(drone, time)

    def _trail(self, time: float) -> Vector:
        times = time - np.arange(0.0, _TRAIL, _TRAIL_STEP)[::-1]
        k = np.clip(np.searchsorted(self._t, times), 0, len(self._t) - 1)
        trail: Vector = self._p[k].swapaxes(0, 1)
        return trail


@dataclass
class Live:
    """A flight under way: truth from the runner, beliefs from the growing logs."""

    scenario: Scenario
    world: dict[str, Any]
    folder: Path
    live: bool = True
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.names = drone_names(self.scenario)
        self._frames = own_frames(self.scenario, self.world)
        self._followers = [Follower(log_path(self.folder, n), "/tick") for n in self.names]
        self._records: list[dict[str, Any] | None] = [None] * len(self.names)
        start = np.array([f.origin for f in self._frames])
        level = np.tile([1.0, 0.0, 0.0, 0.0], (len(start), 1))
        self._path = [start]
        self._now = Moment(0.0, start, level, start[:, None])

    def update(self, time: float, p: Vector, q: Vector) -> None:
        """Take the state of the world at `time` [s]; called by the runner as it flies."""
        if time - self._now.time < 0.04:
            return
        if round(time / 0.04) % round(_TRAIL_STEP / 0.04) == 0:
            self._path = [*self._path[-round(_TRAIL / _TRAIL_STEP) :], p.copy()]
        self._now = Moment(time, p.copy(), q.copy(), np.stack([*self._path, p], axis=1))

    def events(self) -> list[Event]:
        """Return none: they are told when the flight is over."""
        return []

    @property
    def duration(self) -> float:
        """The present [s]."""
        return self._now.time

    def moment(self, time: float) -> Moment:
        """Return the present, at any `time`."""
        return self._now

    def belief(self, drone: int, time: float) -> Belief | None:
        """Return the belief at the newest tick in the drone's log, at most half a second old."""
        for message in self._followers[drone].new()[-1:]:
            self._records[drone] = orjson.loads(message.data)
        record = self._records[drone]
        if record is None:
            return None
        return belief_of(record, self._frames[drone], drone, self._now.p)
