"""Slow errors of the state estimates and the faults of estimators, from a seed.

A vehicle's errors depend on the seed and its system id alone. The errors are those of a filter
that believes its inertial sensors over seconds and its position sensor over minutes: a slow error
of the position hardly shows in the reported velocity, a fast one does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavlink_bridge.wire.ids import GpsFix
from sitl_sim.vehicles.estimator import BLOCK_SUBSTEPS, TICK_SUBSTEPS, Estimate
from sitl_sim.vehicles.grades import Grade, Span, Steps
from sitl_sim.vehicles.rigid_body import SUBSTEP, State

Floats = NDArray[np.float64]

DT = TICK_SUBSTEPS * SUBSTEP
CHANNELS = 12  # slow and fast position, velocity, attitude; three axes each
DRAWS = CHANNELS + 4  # and the random walks of yaw and of position
SLIDE_TIME = 1.0  # s, in which a velocity that slides becomes wrong: 0.8 m/s² to 0.8 m/s
COMPASS_TIME = 2.0  # s, in which the filter's yaw follows a wrong compass
GATE = 5.0 * 0.5  # m, of the position innovation: EKF2_GPS_P_GATE times EKF2_GPS_P_NOISE
HEADING_GATE = 2.6 * 0.3  # rad, EKF2_HDG_GATE times EKF2_HEAD_NOISE
LEAST_SLIDE = 0.1  # s
SLIDE = Steps(math.inf, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), slide=0.3)  # of a fault alone
QUIET = 0.1  # test ratio of an innovation without a fault


class StateErrors:
    """Errors of n estimates, and what each estimator reports of itself.

    position_sigma, velocity_sigma, attitude_sigma (n,3): m and m/s, world; rad, body. resets (n,):
    jumps of the estimate so far. horizontal_ratio, heading_ratio (n,): test ratios of innovations.
    floating (n,): whether the RTK solution floats. offset (n,3): m, of a fault.
    """

    def __init__(self, system_ids: Sequence[int], grades: Sequence[Grade], seed: int) -> None:
        n = len(system_ids)
        self.grades = list(grades)
        self._rngs = [np.random.default_rng([seed, 0x57A7E, s]) for s in system_ids]
        self._fates = [np.random.default_rng([seed, 0x57E9, s]) for s in system_ids]
        self._active = np.array([g != Grade(g.noise) for g in grades])
        self._draw_vehicles()
        self._walks = np.array([[g.yaw_walk, *[g.walk] * 3] for g in grades]).reshape(n, 4)
        self._noise = np.zeros((n, BLOCK_SUBSTEPS // TICK_SUBSTEPS, DRAWS))
        first = np.array([r.standard_normal((2, CHANNELS)) for r in self._rngs])
        self._x = self._sigma * first[:, 0]
        self._rate = self._sigma / self._time * first[:, 1]
        self._drift = np.zeros((n, 3))  # m, of the walk, the scale and the wrong yaw
        self._drifting = np.zeros((n, 3))  # m/s, the part of it that the velocity shows
        self._yaw = np.zeros(n)  # rad, of the walk and of resets
        self._slow_v = np.zeros((n, 3))  # m/s, for the latency
        self._baro = np.zeros(n)
        self._aim = np.zeros((n, 3))  # m, where a step of the position sensor leads
        self._step = np.zeros((n, 3))  # m, how far the filter has followed
        self._sliding = np.zeros((n, 3))  # m/s
        self._compass = np.zeros(n)
        self._now = 0.0
        self._next = np.array([self._wait(i) for i in range(n)])
        self._back = np.full(n, np.inf)
        # Set by faults.
        self.offset = np.zeros((n, 3))  # m, at once
        self._wrong_compass = np.zeros(n)  # rad
        self._height_rate = np.zeros(n)  # m/s
        self._forced_float = np.zeros((n, 3))  # m, of a solution that is made to float
        self._forced_slide = np.zeros((n, 3))  # m/s, where the velocity's error is led
        self._slide_v = np.zeros((n, 3))  # m/s, how far it is
        self._idle = not self._active.any()  # nothing to step: the cost of a perfect estimate
        self.resets = np.zeros(n, dtype=np.int64)
        self.floating = np.zeros(n, dtype=np.bool_)
        self.horizontal_ratio = np.full(n, QUIET)
        self.heading_ratio = np.full(n, QUIET)
        self.position_sigma = _rows(
            grades, "reported_position", "reported_position", "reported_height"
        )
        self.velocity_sigma = _rows(grades, *["reported_velocity"] * 3)
        self.attitude_sigma = _rows(
            grades, "reported_attitude", "reported_attitude", "reported_yaw"
        )
        self._sure = self.position_sigma
        self._unsure = _rows(grades, *["reported_float"] * 3)
        steps = [g.steps or SLIDE for g in grades]
        self._slide_time = np.array([max(step.slide, LEAST_SLIDE) for step in steps])
        self._shown = np.array([step.shown for step in steps])

    def _draw_vehicles(self) -> None:
        """Draw each vehicle's own sigmas, biases and latency."""
        sigma, time, bias, baro, latency, scale = [], [], [], [], [], []
        for g, rng in zip(self.grades, self._rngs, strict=True):
            wander, up = _draw(g.wander, rng), _draw(g.wander_up, rng)
            tilt = _draw(g.tilt, rng)
            sigma.append([wander, wander, up, *[g.flutter] * 3, *[g.velocity] * 3, *[tilt] * 3])
            time.append(
                [*[g.wander_time] * 3, *[g.flutter_time] * 3, *[g.velocity_time] * 3]
                + [g.tilt_time] * 3
            )
            bias.append(_draw(g.yaw_bias, rng) * rng.choice([-1.0, 1.0]))
            baro.append(_draw(g.baro, rng) * rng.choice([-1.0, 1.0]))
            latency.append(_draw(g.latency, rng))
            scale.append(g.scale * rng.standard_normal())
        self._sigma = np.array(sigma).reshape(-1, CHANNELS)
        self._time = np.array(time).reshape(-1, CHANNELS)
        self.yaw_bias, self.baro_rate = np.array(bias), np.array(baro)
        self.latency, self.scale = np.array(latency), np.array(scale)
        self._follow = DT / np.array([g.latency_filter for g in self.grades])
        # The velocity shows the fast error of the position, and has one of its own.
        self._kick = 2.0 * self._sigma * np.sqrt(DT) / self._time**1.5

    def wander_sigma(self, i: int) -> Floats:
        """Return the standard deviation (3,) m that vehicle i drew for its slow position error."""
        return self._sigma[i, :3]

    def _wait(self, i: int) -> float:
        steps = self.grades[i].steps
        return self._now + self._fates[i].exponential(steps.every) if steps else np.inf

    def next_block(self) -> None:
        """Draw the noise of the next second."""
        shape = self._noise.shape[1:]
        for i in np.flatnonzero(self._active):
            self._noise[i] = self._rngs[i].standard_normal(shape)

    def step(self, tick: int, state: State, estimate: Estimate) -> None:
        """Step all errors by 10 ms, number `tick` of the block, and write `estimate.error`."""
        if self._idle:
            return
        self._now += DT
        noise = self._noise[:, tick]
        self._rate += (
            -2.0 * self._rate / self._time - self._x / self._time**2
        ) * DT + self._kick * noise[:, :CHANNELS]
        self._x += self._rate * DT
        for i in np.flatnonzero((self._next <= self._now) | (self._back <= self._now)):
            self._change_step(int(i))
        self._slide()
        self._drift_on(state, noise[:, CHANNELS:])
        lag_v = self.latency[:, None] * (state.v - self._slow_v) * (self._follow / DT)[:, None]
        self._slow_v += self._follow[:, None] * (state.v - self._slow_v)
        self._baro += (self.baro_rate + self._height_rate) * DT
        self._compass += (self._wrong_compass - self._compass) * DT / COMPASS_TIME
        self._slide_v += (self._forced_slide - self._slide_v) * DT / SLIDE_TIME
        self._drift += self._slide_v * DT
        error, x = estimate.error, self._x
        error[:, :3] = x[:, :3] + x[:, 3:6] + self._drift + self._step + self.offset
        error[:, :3] -= self.latency[:, None] * self._slow_v
        error[:, 2] += self._baro
        error[:, 3:6] = x[:, 6:9] + self._rate[:, 3:6] + self._drifting + self._sliding - lag_v
        error[:, 3:6] += self._slide_v
        error[:, 6:] = x[:, 9:]
        error[:, 6:] += (self.yaw_bias + self._yaw + self._compass)[:, None] * _up_in_body(state.q)
        self._report()

    def _drift_on(self, state: State, noise: Floats) -> None:
        """Let the position drift: it is summed up from a scaled and turned velocity."""
        self._yaw += self._walks[:, 0] * math.sqrt(DT) * noise[:, 0]
        c, s = np.cos(self._yaw) * (1.0 + self.scale), np.sin(self._yaw) * (1.0 + self.scale)
        v, moves = state.v, (self._walks[:, 1] > 0.0) | (self.scale != 0.0)
        shown = self._drifting
        shown[:, 0] = np.where(moves, (c - 1.0) * v[:, 0] - s * v[:, 1], 0.0)
        shown[:, 1] = np.where(moves, s * v[:, 0] + (c - 1.0) * v[:, 1], 0.0)
        shown[:, 2] = self.scale * v[:, 2]
        way = np.linalg.norm(v, axis=1) * DT
        self._drift += shown * DT + self._walks[:, 1:] * np.sqrt(way)[:, None] * noise[:, 1:]

    def _change_step(self, i: int) -> None:
        """Begin or end a step of vehicle i's position sensor."""
        steps, rng = self.grades[i].steps, self._fates[i]
        assert steps is not None
        if self._back[i] <= self._now:
            self._aim[i], self._back[i] = 0.0, np.inf
            self.floating[i] = False
            self._next[i] = self._wait(i)
            return
        offset = _step(steps.size, steps.up, rng)
        turn, lasts = steps.turn * rng.standard_normal(), _draw(steps.lasts, rng)
        if steps.slide == 0.0:
            self.reset(i, offset, turn)
            self._next[i] = self._wait(i)
            return
        self._aim[i] = offset
        self.floating[i] = steps.floats
        self._next[i], self._back[i] = np.inf, self._now + lasts

    def _slide(self) -> None:
        """Let the filters follow the steps of their position sensors."""
        left = self._aim + self._forced_float - self._step
        rate = left / self._slide_time[:, None]
        self._step += rate * DT
        self._sliding = self._shown[:, None] * rate
        self.horizontal_ratio = QUIET + (left[:, :2] ** 2).sum(axis=1) / GATE**2

    def _report(self) -> None:
        self.heading_ratio = QUIET + ((self._wrong_compass - self._compass) / HEADING_GATE) ** 2
        floats = self.floating | self._forced_float.any(axis=1)
        self.position_sigma = np.where(floats[:, None], self._unsure, self._sure)

    # Faults.

    def shift(self, i: int, offset: ArrayLike) -> None:
        """Shift vehicle i's position by `offset` (3,) m: its filter does not notice."""
        self._idle = False
        self.offset[i] = offset

    def reset(self, i: int, offset: ArrayLike, turn: float = 0.0) -> None:
        """Let vehicle i's estimate jump by `offset` (3,) m and `turn` [rad], and count it."""
        self._idle = False
        self._drift[i] += np.asarray(offset, dtype=np.float64)
        self._yaw[i] += turn
        self.resets[i] += 1

    def float_solution(self, i: int, size: float) -> None:
        """Let vehicle i's RTK solution float, `size` [m] off, or be fixed again with 0."""
        self._idle = False
        towards = self._fates[i].uniform(0.0, 2.0 * math.pi) if size else 0.0
        self._forced_float[i] = [size * math.cos(towards), size * math.sin(towards), size]

    def turn_compass(self, i: int, angle: float) -> None:
        """Let vehicle i's compass be wrong by `angle` [rad]; its yaw follows in a few seconds."""
        self._idle = False
        self._wrong_compass[i] = angle

    def slide(self, i: int, velocity: ArrayLike) -> None:
        """Let vehicle i's velocity be wrong by `velocity` (3,) m/s, and its position with it."""
        self._idle = False
        self._forced_slide[i] = velocity

    def drift_height(self, i: int, rate: float) -> None:
        """Let vehicle i's height drift at `rate` [m/s], on top of its own drift."""
        self._idle = False
        self._height_rate[i] = rate

    def fix(self, i: int) -> GpsFix:
        """Return the GPS fix type of vehicle i."""
        g = self.grades[i]
        floats = self.floating[i] or self._forced_float[i].any()
        return GpsFix.RTK_FLOAT if floats and g.fix is GpsFix.RTK_FIXED else g.fix


def _rows(grades: Sequence[Grade], *names: str) -> Floats:
    rows: Floats = np.array([[getattr(g, name) for name in names] for g in grades]).reshape(-1, 3)
    return rows


def _draw(span: Span, rng: np.random.Generator) -> float:
    low, high = span
    return low if low == high else float(rng.uniform(low, high))


def _step(size: Span, up: Span, rng: np.random.Generator) -> Floats:
    """Draw a step (3,) m in a random direction along the ground, and up or down."""
    away, towards = _draw(size, rng), rng.uniform(0.0, 2.0 * math.pi)
    height = _draw(up, rng) * rng.choice([-1.0, 1.0])
    return np.array([away * math.cos(towards), away * math.sin(towards), height])


def _up_in_body(q: Floats) -> Floats:
    """Return the world's upward direction (n,3) in body axes; q (n,4) body → world."""
    w, x, y, z = q.T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)
