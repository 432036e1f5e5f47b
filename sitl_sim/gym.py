"""The swarm as a PettingZoo `ParallelEnv`: one agent for each drone, for learning; extra `[gym]`.

    from sitl_sim.gym import SwarmEnv

    env = SwarmEnv("tunnel")
    observations, infos = env.reset(seed=7)
    while env.agents:
        actions = {a: env.action_space(a).sample() for a in env.agents}
        observations, rewards, terminations, truncations, infos = env.step(actions)

An agent sees what its companion knows (`gym_actor.observation`), never the truth; with
`observation="picture"` or `"depth"` what its camera shows as well. It gives a horizontal velocity
[m/s], which the companion tracks at the goal's height; with `action="rates"` thrust and body rates.
The companion takes off and lands, and its guard keeps the last word. A step is one tick, 0.1 s.
The same seed and actions give the same flight. Perfect sensing unless pictures are observed, or
changes say `sensing.neighbours: camera`.
"""

from __future__ import annotations

import itertools
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.api import load
from sitl_sim.flight.runner import Flight, flight
from sitl_sim.gym_actor import SIZE, UPRIGHT, Actor, FlightEnded, InputActor, Meeting
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.worlds.world import surface_distance

_COLLISION = -10.0  # reward
_SENSING = {
    "instance": ("truth", "map"),
    "picture": ("camera", "camera"),
    "depth": ("truth", "depth"),
}
"""Observation → what neighbours and obstacles are sensed by, where changes do not say it."""
_INPUTS = ((2.0, -3.0, -3.0, -3.0), (20.0, 3.0, 3.0, 3.0))  # c [m/s²], ω [rad/s]; the NMPC's
_SLOW = 0.1  # m/s; below this, as where the drone has arrived, a way has no direction
_numbers = itertools.count()


Seen = Vector | dict[str, Any]
"""An observation: numbers, or numbers and a picture."""


class SwarmEnv(ParallelEnv[str, Seen, Vector]):  # type: ignore[misc]
    """Flies a scenario; each agent's reward is its way towards its goal [m], −10 at a collision.

    changes: dotted key → value, as in `sitl_sim.load`. speed_max: m/s, bound of a velocity.
    observation: instance, what the NMPC's instance holds, as numbers; picture or depth: a mapping
    of these (`instance`) and what the camera shows (`picture` (h,w,3) uint8 BGR, `depth` (h,w) m,
    inf where nothing is near). action: velocity (2,) m/s; rates: (4,) thrust c [m/s²], ω [rad/s].
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "swarm_v0", "render_modes": []}
    render_mode = None

    def __init__(
        self,
        scenario: str | Path,
        *,
        drones: int | None = None,
        changes: Mapping[str, Any] | None = None,
        speed_max: float = 2.0,
        observation: Literal["instance", "picture", "depth"] = "instance",
        action: Literal["velocity", "rates"] = "velocity",
    ) -> None:
        if observation not in _SENSING or action not in ("velocity", "rates"):
            raise ValueError(
                f"observation {observation!r}, action {action!r}; valid: {', '.join(_SENSING)}; "
                "velocity, rates"
            )
        self._kind, self._actor = observation, InputActor if action == "rates" else Actor
        neighbours, obstacles = _SENSING[observation]
        self._key = str(next(_numbers))
        self._scenario, self._drones = scenario, drones
        self._changes = {
            "sensing.neighbours": neighbours,
            "sensing.obstacles": obstacles,
            **(changes or {}),
            "companion.controller": f"{self._actor.__module__}:{self._actor.__name__}",
            "companion.controller_options": {"meeting": self._key},
        }
        loaded = self._load(0)
        foreign = loaded.drones.foreign
        self._index = {
            n: i for i, n in enumerate(scenarios.drone_names(loaded)) if n not in foreign
        }
        self.possible_agents = list(self._index)
        self.agents: list[str] = []
        if action == "rates":
            low, high = (np.array(end, np.float32) for end in _INPUTS)
            actions = spaces.Box(low, high, dtype=np.float32)
        else:
            actions = spaces.Box(-speed_max, speed_max, (2,), np.float32)
        size = SIZE + (UPRIGHT if action == "rates" else 0)
        self._spaces = (_observed(observation, size, loaded), actions)
        self._seed = 0
        self._thread: threading.Thread | None = None
        self._flight: Flight
        self._failure: BaseException | None = None

    def _load(self, seed: int) -> Scenario:
        return load(self._scenario, seed=seed, drones=self._drones, changes=self._changes)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of observations, the same for all."""
        return self._spaces[0]

    def action_space(self, agent: str) -> spaces.Box:
        """Return the space of actions; a velocity is east and north of the drone's own frame."""
        return self._spaces[1]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Seen], dict[str, Any]]:
        """Begin a flight; without a seed, that of the next number."""
        self.close()
        self._seed = self._seed + 1 if seed is None else seed
        self.agents = list(self.possible_agents)
        self._meeting = Meeting(self.possible_agents, self._picture)
        self._actor.meetings[self._key] = self._meeting
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()
        self._meeting.step({})
        while not self._meeting.over and len(self._meeting.seen) < len(self.agents):
            self._meeting.step({})
        self._raise_failure()
        return self._observations(), {a: {} for a in self.agents}

    def step(
        self, actions: Mapping[str, Vector]
    ) -> tuple[dict[str, Seen], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Any]]:
        """Fly one tick, 0.1 s."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        before, agents = self._flight.vehicles.p.copy(), list(self.agents)
        low, high = self._spaces[1].low, self._spaces[1].high
        self._meeting.step({a: np.clip(v, low, high) for a, v in actions.items()})
        self._raise_failure()
        after = self._flight.vehicles.p
        hit = self._touching()
        over = self._meeting.over
        rewards, ended = {}, {}
        for name, i in self._index.items():
            if name in agents:
                way = self._meeting.seen[name][2:4].astype(float)
                size = max(float(np.linalg.norm(way)), _SLOW)
                moved = self._own_axes(i, after[i] - before[i])
                rewards[name] = float(moved @ way / size) + (_COLLISION if hit[i] else 0.0)
                ended[name] = bool(hit[i])
        seen = {a: self._observation(a) for a in agents}
        infos = {a: {"time": self._flight.simulated_seconds} for a in agents}
        truncated = {a: over and not ended[a] for a in agents}
        self.agents = [a for a in agents if not ended[a] and not over]
        return seen, rewards, ended, truncated, infos

    def close(self) -> None:
        """End the flight."""
        if self._thread is not None:
            self._meeting.close()
            self._thread.join()
            self._actor.meetings.pop(self._key, None)
            self._thread = None

    def render(self) -> None:
        """Do nothing: `sitl-sim view` shows flights that are kept."""

    def _observations(self) -> dict[str, Seen]:
        return {a: self._observation(a) for a in self.agents}

    def _observation(self, agent: str) -> Seen:
        known = self._meeting.seen[agent]
        if self._kind == "instance":
            return known
        return {"instance": known, self._kind: self._meeting.pictures[agent]}

    def _picture(self, name: str) -> Any:
        """Return what the drone's camera showed in its present tick; None: nothing is observed."""
        if self._kind == "instance":
            return None
        arrays = self._flight.frame_arrays(name)
        return arrays["image" if self._kind == "picture" else "depth"].copy()

    def _own_axes(self, i: int, v: Vector) -> Vector:
        """Return a vector of the world (3,) in drone i's own axes, horizontal (2,)."""
        yaw = float(self._yaws[i])
        c, s = np.cos(yaw), np.sin(yaw)
        return np.array([c * v[0] + s * v[1], c * v[1] - s * v[0]])

    def _touching(self) -> Vector:
        """Return (N,) whether each drone touches another or an obstacle."""
        p, radius = self._flight.vehicles.p, float(self._flight.world["drone_radius"])
        apart = np.linalg.norm(p[:, None] - p[None], axis=-1) + np.eye(len(p)) * 1e6
        obstacle = surface_distance(p, self._flight.world) < radius
        touching: Vector = (apart.min(axis=1) < 2 * radius) | obstacle
        return touching

    def _raise_failure(self) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def _fly(self) -> None:
        """Fly until the end; the flight's thread."""
        try:
            self._meeting.begin()
            scenario = self._load(self._seed)
            self._yaws = placement.frame_yaws(scenario)
            with (
                tempfile.TemporaryDirectory() as folder,
                flight(scenario, Path(folder), in_process=True) as f,
            ):
                self._flight = f
                f.write_inputs()
                f.launch()
                f.wait_for_companions()
                f.run()
        except FlightEnded:
            pass
        except BaseException as error:
            self._failure = error
        finally:
            self._meeting.ended()


def _observed(kind: str, size: int, scenario: Scenario) -> spaces.Space[Any]:
    """Return the space of observations."""
    numbers = spaces.Box(-np.inf, np.inf, (size,), np.float32)
    if kind == "instance":
        return numbers
    s = scenario.sensing
    sensed = {s.neighbours, s.obstacles}
    if (kind == "picture" and "camera" not in sensed) or (
        kind == "depth" and "depth" not in sensed
    ):
        raise SettingsError(
            [f"sensing: no {kind} is rendered: neighbours {s.neighbours}, obstacles {s.obstacles}"]
        )
    if kind == "picture":
        shown: spaces.Box[Any] = spaces.Box(0, 255, (s.height, s.width, 3), np.uint8)
    else:
        shape = (round(s.depth.width * s.height / s.width), s.depth.width)
        shown = spaces.Box(0.0, np.inf, shape, np.float32)
    return spaces.Dict({"instance": numbers, kind: shown})
