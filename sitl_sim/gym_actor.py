"""The seat of an outside policy in a companion: a controller that asks for its velocity or input.

A companion finds `Actor` or `InputActor` by `module:Class`, as any controller of a user. `Meeting`
is where all actors of a flight and the environment wait for each other: the flight goes on in a
thread of its own while the environment waits, and stands still while the policy thinks.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY

NEIGHBOURS, SURFACES = 8, 8
SIZE = 6 + 5 * NEIGHBOURS + 3 * SURFACES
"""Numbers in an observation."""
UPRIGHT = 6
"""Numbers more where the action is thrust and rates: `upright`."""
HOVER = (GRAVITY, 0.0, 0.0, 0.0)
"""Input without a policy: c [m/s²], ω [rad/s]."""


class FlightEnded(BaseException):
    """The flight is to end: no exception that a companion may answer with HOLD."""


class Meeting:
    """Hands observations to the environment, and its actions to the actors.

    A step lasts until an actor asks for the second time: then each has been asked once, and the
    actor that came first waits. Only one of the two threads runs at any time.
    """

    def __init__(
        self, names: Iterable[str], picture: Callable[[str], Any] = lambda _: None
    ) -> None:
        """picture: what a drone's camera showed in its present tick."""
        self._names = iter(names)
        self._picture = picture
        self.seen: dict[str, Vector] = {}
        self.pictures: dict[str, Any] = {}
        self.actions: Mapping[str, Vector] = {}
        self.over = False
        self._asked: set[str] = set()
        self._closing = False
        self._flight_may_run = threading.Semaphore(0)
        self._env_may_run = threading.Semaphore(0)

    def take_name(self) -> str:
        """Return the name of the next actor: companions are made in the order of the drones."""
        return next(self._names)

    def action(self, name: str, observation: Vector, idle: Sequence[float]) -> Vector:
        """Take what an actor sees; return its action. Called by the flight's thread.

        idle: the action without one of the policy's.
        """
        if name in self._asked:
            self._asked.clear()
            self._env_may_run.release()
            self._wait()
        self._asked.add(name)
        self.seen[name], self.pictures[name] = observation, self._picture(name)
        return np.asarray(self.actions.get(name, idle), float)

    def begin(self) -> None:
        """Wait until the environment wants the flight to begin. Called by the flight's thread."""
        self._wait()

    def _wait(self) -> None:
        self._flight_may_run.acquire()
        if self._closing:
            raise FlightEnded

    def ended(self) -> None:
        """Tell the environment that the flight is over. Called by the flight's thread."""
        self.over = True
        self._env_may_run.release()

    def step(self, actions: Mapping[str, Vector]) -> None:
        """Fly on with these actions until all have been asked, or the flight is over."""
        self.actions = actions
        self._flight_may_run.release()
        self._env_may_run.acquire()

    def close(self) -> None:
        """Let the flight end at its next question."""
        self._closing = True
        self._flight_may_run.release()


class _Seat:
    """An actor of a meeting; `options`: the meeting's key."""

    meetings: ClassVar[dict[str, Meeting]] = {}

    def __init__(self, setup: Any) -> None:
        self._meeting = self.meetings[setup.options["meeting"]]
        self._name = self._meeting.take_name()
        self._tested = False

    def _ask(self, observed: Vector, idle: Sequence[float]) -> Vector:
        """Return the policy's action.

        The first question is the planner's self-test on the ground, which no policy sees.
        """
        if not self._tested:
            self._tested = True
            return np.asarray(idle, float)
        return self._meeting.action(self._name, observed, idle)


class Actor(_Seat):
    """A rule whose velocity comes from outside."""

    def velocity(self, around: Any) -> Vector:
        """Return the velocity (2,) m/s of the policy."""
        return self._ask(observation(around), (0.0, 0.0))


class InputActor(_Seat):
    """A rule whose thrust and body rates come from outside."""

    def command(self, around: Any, instance: Any) -> Vector:
        """Return the input (4,) of the policy: c [m/s²], ω [rad/s], body axes."""
        observed = np.concatenate([observation(around), upright(instance)])
        return self._ask(observed.astype(np.float32), HOVER)


def upright(instance: Any) -> Vector:
    """Return (6,): height of the goal above the drone [m], climb [m/s], attitude quaternion."""
    x = instance.x0
    return np.array([instance.goal[2] - x[2], x[5], *x[6:10]])


def observation(around: Any) -> Vector:
    """Return what a drone knows as (SIZE,) numbers, relative to it, horizontal, world axes.

    Own velocity (2), velocity towards the goal (2), fastest speed (1), 1; for each of 8 neighbours
    place (2), velocity (2), 1 where there is one; for each of 8 obstacles the nearest point (2), 1
    where there is one. Nearest first; m, m/s.
    """
    neighbours = np.column_stack([around.neighbours, around.velocities])
    return np.concatenate(
        [
            around.v,
            around.migration,
            [around.fastest, 1.0],
            _rows(neighbours, NEIGHBOURS, 4),
            _rows(around.surfaces, SURFACES, 2),
        ]
    ).astype(np.float32)


def _rows(found: Vector, most: int, width: int) -> Vector:
    """Return the nearest rows, each with a 1, and zeros for the rest, flat."""
    near = found[np.argsort(np.linalg.norm(found[:, :2], axis=1), kind="stable")][:most]
    rows = np.zeros((most, width + 1))
    rows[: len(near), :width] = near
    rows[: len(near), width] = 1.0
    return rows.reshape(-1)
