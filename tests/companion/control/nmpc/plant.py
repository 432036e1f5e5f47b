"""A small closed loop for the controller's tests: a plant with lag, drag and delay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.control.nmpc import Instance, Neighbour, Nmpc, NmpcConfig, make_instance
from companion.model import (
    HOVER,
    f,
    normalise,
    observed_disturbance,
    predict,
)
from companion.types import Plan
from mavlink_bridge.shared.frames import quaternion_from_euler

TICK = 0.1
STEP = 0.005
RATE_LAG = 0.04
THRUST_LAG = 0.03
DRAG = 0.25  # 1/s, linear
LAG = 0.03  # s that the predictor adds to the delay for the actuators

NO_CYLINDERS, NO_PLANES = np.zeros((0, 3)), np.zeros((0, 4))


@dataclass
class Drone:
    """Plant and controller of one drone."""

    x: np.ndarray
    nmpc: Nmpc
    delay: float = 0.05
    wind: np.ndarray = field(default_factory=lambda: np.zeros(3))
    actual: np.ndarray = field(default_factory=lambda: HOVER.copy())
    sent: list[np.ndarray] = field(default_factory=lambda: [HOVER.copy()] * 5)
    result: Plan | None = None
    disturbance: np.ndarray = field(default_factory=lambda: np.zeros(3))
    before: np.ndarray | None = None

    def flow(self, x: np.ndarray, start: float, end: float) -> np.ndarray:
        """State at `end` from `x` at `start` (seconds from now) under the inputs as sent."""
        late = self.delay + LAG
        while end - start > 1e-9:
            ago = int(np.ceil((late - start) / TICK - 1e-9))
            until = min(end, late - (ago - 1) * TICK)
            x = predict(x, self.sent[-ago], until - start, self.disturbance)
            start = until
        return x

    def observe(self) -> None:
        """Correct the disturbance by how wrong the last tick's prediction was."""
        if self.before is not None:
            expected = self.flow(self.before, -TICK, 0.0)
            self.disturbance = observed_disturbance(
                self.disturbance, expected[3:6], self.x[3:6], TICK
            )
        self.before = self.x.copy()

    def now(self) -> np.ndarray:
        """Prediction of the state at which the next input takes effect."""
        return self.flow(self.x, 0.0, self.delay + LAG)

    def advance(self, u: np.ndarray) -> None:
        """One tick of the plant; `u` takes effect after the delay."""
        self.sent = [*self.sent[1:], u]
        for n in range(round(TICK / STEP)):
            ago = self.delay - n * STEP
            wanted = self.sent[-1 - max(0, int(np.ceil(ago / TICK - 1e-9)))]
            lag = np.array([THRUST_LAG, RATE_LAG, RATE_LAG, RATE_LAG])
            self.actual = self.actual + (wanted - self.actual) * (1 - np.exp(-STEP / lag))
            push = -DRAG * (self.x[3:6] - self.wind)
            middle = self.x + STEP / 2 * np.array(f(self.x, self.actual))
            self.x = self.x + STEP * np.array(f(middle, self.actual, push))
            self.x[6:10] = normalise(self.x[6:10])


def drone(config: NmpcConfig, p: list[float], yaw: float = 0.0, **kwargs: object) -> Drone:
    x = np.concatenate([p, np.zeros(3), quaternion_from_euler(0.0, 0.0, yaw)])
    return Drone(x, Nmpc(config), **kwargs)  # type: ignore[arg-type]


@dataclass
class Log:
    """The record of a flight: one row per tick and drone."""

    x: np.ndarray
    u: np.ndarray
    results: list[list[Plan]]

    @property
    def p(self) -> np.ndarray:
        return self.x[..., :3]

    @property
    def speed(self) -> np.ndarray:
        return np.linalg.norm(self.x[..., 3:6], axis=-1)

    def clearance(self, cylinders: np.ndarray) -> float:
        d = self.p[:, :, None, :2] - cylinders[None, None, :, :2]
        return float((np.linalg.norm(d, axis=-1) - cylinders[:, 2]).min())

    def separation(self) -> float:
        d = self.p[:, :, None] - self.p[:, None]
        n = np.linalg.norm(d, axis=-1) + np.eye(d.shape[1]) * 1e9
        return float(n.min())


def fly(
    drones: list[Drone],
    goals: list[list[float]],
    seconds: float,
    *,
    cylinders: np.ndarray = NO_CYLINDERS,
    planes: np.ndarray = NO_PLANES,
    gaze: Callable[[float], float] = lambda t: 0.0,
    sight: float = 12.0,
    stop: float = 0.0,
    seen: Callable[[int, int, Instance], None] = lambda tick, drone, instance: None,
) -> Log:
    """Fly; neighbours are perfectly seen, the nearest first, with cohesion where they fly along.

    seen(tick, drone, instance): called with every instance.
    """
    config = drones[0].nmpc.config
    xs, us, results = [], [], []
    yaws = [float("nan")] * len(drones)
    for tick in range(round(seconds / TICK)):
        before = [d.x.copy() for d in drones]
        commands = []
        for i, d in enumerate(drones):
            d.observe()
            x0 = d.now()
            v = x0[3:6]
            if np.hypot(v[0], v[1]) > 0.3 or np.isnan(yaws[i]):
                e = np.array(goals[i]) - x0[:3]
                want = (
                    np.arctan2(v[1], v[0]) if np.hypot(v[0], v[1]) > 0.3 else np.arctan2(e[1], e[0])
                )
                yaws[i] = float(want)
            others = sorted(
                (x for j, x in enumerate(before) if j != i),
                key=lambda x: float(np.linalg.norm(x[:3] - before[i][:3])),
            )
            late = d.delay + LAG
            near = cylinders[np.argsort(np.hypot(*(cylinders[:, :2] - x0[:2]).T) - cylinders[:, 2])]
            near = near[np.hypot(*(near[:, :2] - x0[:2]).T) - near[:, 2] < sight]
            instance = make_instance(
                config,
                x0=x0,
                u_last=d.sent[-1],
                goal=goals[i],
                yaw=yaws[i] + gaze(tick * TICK),
                neighbours=[
                    Neighbour(
                        x[:3] + late * x[3:6],
                        x[3:6],
                        cohesion=float(
                            x[3:6] @ v > 0.5 * max(v @ v, x[3:6] @ x[3:6]) and v @ v > 0.25
                        ),
                    )
                    for x in others
                    if np.linalg.norm(x[:3] - before[i][:3]) < sight
                ],
                cylinders=near,
                planes=planes,
                disturbance=d.disturbance,
            )
            seen(tick, i, instance)
            d.result = d.nmpc.solve(instance)
            commands.append(d.result.u[0])
        for d, u in zip(drones, commands, strict=True):
            d.advance(u)
        xs.append(before)
        us.append(commands)
        results.append([d.result for d in drones])
        if stop and all(
            np.linalg.norm(d.x[:3] - g) < stop for d, g in zip(drones, goals, strict=True)
        ):
            break
    return Log(np.array(xs), np.array(us), results)  # type: ignore[arg-type]


def forest(seed: int, side: int = 7, spacing: float = 7.0, jitter: float = 1.5) -> np.ndarray:
    """The paper's forest: side × side cylinders of 1 m radius, jittered, centred on the origin."""
    rng = np.random.default_rng(seed)
    k = (np.arange(side) - (side - 1) / 2) * spacing
    xy = np.stack(np.meshgrid(k, k), -1).reshape(-1, 2)
    xy = xy + rng.uniform(-jitter, jitter, xy.shape)
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
