"""Errors of the own velocity, as the ground in the pictures shows them.

An autopilot that is sure of a wrong velocity sums it up into a wrong position: the two agree, and
nothing that it tells shows the error. A compass that is wrong turns all that is seen, and not the
velocity that a satellite receiver measures: a drone that flies straight at a trunk sees it come
from the side. The ground shows both (`ground_flow.py`): its flow is the velocity in the frame of
what is seen. The told velocity differs from it by an error that comes and goes, by a turn that
stays (the error of the heading), and by a factor (the height over ground); a told attitude that
leans lets the ground seem to move while the drone turns on the spot. A Kalman filter tells the four
apart by how long they last, and by how the drone moves. An error far beyond what the autopilot says
of itself shows as innovations that agree for longer than noise does: then the filter believes that
the velocity may be as wrong as they say. An error of the velocity changes slowly; flows that jump
from one to the next are wrong themselves, by a trunk whose corners pass for the ground's. Where the
told heading turns and the gyro does not (`turns.py`), the turn is known at once; and so is a step
of the told velocity that the tilt does not explain (`velocity_lag.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from companion.estimation.height import Height
from companion.estimation.own_doubt import ATTITUDE_TIME, OwnDoubt
from companion.estimation.turns import Turn
from companion.estimation.velocity_lag import Step
from companion.model import yaw_of
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.wire.messages import VehicleState

# Of a way over ground, 1 σ along it and across: attitude and timing, times the height.
_ALONG, _ACROSS = 0.0115, 0.0085
_SCALE = 0.05  # of the flow, 1 σ: feet of trunks pass faster than the ground
_SHORT, _LONG = 1.5, 5.0  # s: how long an error of the velocity lasts, a small one and a wrong one
_HEADING_LASTS = 300.0  # s: magnetic fields on the way, and the declination
# rad and s: turns that the gyro does not show, summed up over this time, count from this sum on, as
# gyros drift; this share of them is doubted. Between sparse samples the rates may change: a share
# of that change is left open, and does not count.
_TURN, _TURN_TIME, _TURN_DOUBT, _OPEN = 0.03, 3.0, 0.5, 0.5
_STEP_DOUBT = 0.5  # share of a step of the velocity
_AVERAGED = 0.6  # s over which innovations are averaged
_FOLLOWED = 2.0  # the error over that mean: the filter has followed by half
_SURE = 2.0  # standard deviations up to which their mean may be noise
_OUTLIER, _OUTLIER_SIGMAS = 0.6, 2.0  # m/s, and standard deviations; more counts as this much
_JUMP_SIGMAS = 2.0  # standard deviations up to which two flows in turn may differ by their noise
# How far the ground shows shifted, ahead and to the side, over height times tilt: flat lines of
# sight farther than steep ones. Fitted to four drones of one flight: it is 1 and the mean of the
# squared cotangent of the angles below the horizon, of the ground that happens to be in view.
_SHIFT = np.array([1.65, 1.27])
_LONGEST_GAP = 0.25  # s between two pictures
_SLOWEST = 0.2  # m/s; the direction of a slower one is not known
_MADE = 32  # corrections that are remembered: three seconds
_LEVEL = np.eye(2)


@dataclass(frozen=True)
class VelocityBySight:
    """How the velocity that telemetry tells is wrong, in the frame in which the drone sees.

    turn: rad, by which the told yaw is too large, as seen from the told velocity. error: (3,) m/s,
    to be added to the turned velocity. sigma: m/s, largest 1 σ of the corrected velocity.
    turn_sigma: rad, 1 σ. shown: m/s, 1 σ to which the ground shows the velocity; infinite where
    none was seen lately.
    """

    turn: float = 0.0
    error: Vector = field(default_factory=lambda: np.zeros(3))
    sigma: float = OwnDoubt().velocity
    turn_sigma: float = OwnDoubt().yaw
    shown: float = math.inf

    def corrected(self, v: Vector) -> Vector:
        """Return the velocity (3,) m/s of a told one."""
        return _turned(v, self.turn) + self.error

    def told(self, v: Vector) -> Vector:
        """Return the velocity (3,) m/s that is told where `v` is the corrected one."""
        return _turned(v - self.error, -self.turn)


class VelocityFromGround:
    """Follows what the told velocity lacks; `decide` once a tick, `see` for each flow.

    States: the velocity's error east and north [m/s], the turn [rad], the share by which the flow
    is too long, and the tilt by which the ground shows too far ahead and to the left [rad].
    """

    def __init__(self) -> None:
        self._mean: Vector = np.zeros(6)
        self._covariance: Vector | None = None  # None: no ground was seen yet
        self._time = -math.inf  # s, of the last flow
        self._innovation: Vector = np.zeros(2)  # m/s, averaged
        self._spread: Vector | None = None  # (2,2) m²/s², covariance of that mean
        self._wrong = 0.0  # m²/s², variance of an error that the autopilot does not know of
        self._last: tuple[float, Vector] | None = None  # s, and (2,) m/s, the last flow's error
        self._step: Step | None = None  # the last one
        self._unexplained = 0.0  # rad, by which the heading has turned lately and the gyro has not
        self._open = 0.0  # rad², variance of it that sparse samples leave open
        self._made: deque[tuple[float, VelocityBySight]] = deque(maxlen=_MADE)

    def see(
        self,
        flow: GroundFlow,
        before: VehicleState,
        after: VehicleState,
        height: Height,
        doubt: OwnDoubt,
    ) -> None:
        """Take in a way over the ground.

        before, after: the states, as corrected, at its ends. doubt: of the own state, as told.
        """
        dt = flow.after - flow.before
        if not 0.0 < dt < _LONGEST_GAP or flow.after <= self._time:
            return
        step = self._step
        if step is not None and flow.before < step.until and flow.after > step.since:
            return
        scale = math.hypot(height.sigma / flow.height, _SCALE)
        mean, p = self._predicted(flow.after, doubt, scale)
        made = self._at(0.5 * (flow.before + flow.after))
        told = made.told(0.5 * (before.v + after.v))[:2]
        east, north = told.tolist()
        leaning = flow.height / dt * _shifted(before.q_wb, after.q_wb)
        h = np.column_stack([_LEVEL, [-north, east], told, leaning])
        error = flow.way / dt - told
        off = error - h @ mean
        off = off * min(1.0, _OUTLIER / max(norm(off), 1e-9))
        hp = h @ p
        expected = hp @ h.T
        noise = _noise(told, flow.height / dt)
        share = float(np.trace(expected + noise))
        noise = noise + self._jump(error, flow.after, noise)
        whole = expected + noise
        share /= float(np.trace(whole))
        self._notice(off, whole, share * dt)
        if not self._wrong:
            sigmas = math.sqrt(float(off @ np.linalg.solve(whole, off)))
            noise = noise + (max(sigmas / _OUTLIER_SIGMAS, 1.0) - 1.0) * whole
            whole = expected + noise
        gain = np.linalg.solve(whole, hp).T
        self._mean = mean + gain @ off
        p = p - gain @ hp
        self._covariance = 0.5 * (p + p.T)
        self._time = flow.after

    def turn(self, turns: Iterable[Turn]) -> float:
        """Take in turns that the gyro does not show: so the error of the heading changes.

        Return by how much the told heading has turned [rad], and the drone has not. Before ground
        was seen nothing tells whether the heading is wrong now, or was before.
        """
        whole = 0.0
        for turn in turns:
            kept = math.exp(-turn.dt / _TURN_TIME)
            self._unexplained = kept * self._unexplained + turn.up
            self._open = kept * kept * self._open + turn.spread * turn.spread
            if abs(self._unexplained) < _TURN + _OPEN * math.sqrt(self._open):
                continue
            if self._covariance is not None:
                self._mean[2] += self._unexplained
                self._covariance[2, 2] += (_TURN_DOUBT * self._unexplained) ** 2
            whole += self._unexplained
            self._unexplained = 0.0
        return whole

    def step(self, step: Step) -> bool:
        """Take in by how much the told velocity has stepped: its error has, too.

        A flow over that time shows a part of it, and does not count. Return whether the step does:
        before ground was seen nothing tells whether the velocity is wrong now, or was before.
        """
        if self._covariance is None:
            return False
        self._step = step
        if self._last is not None:
            self._last = self._last[0], self._last[1] - step.change
        self._mean[:2] -= step.change
        self._covariance[:2, :2] += _STEP_DOUBT**2 * np.outer(step.change, step.change)
        return True

    def decide(self, time: float, v: Vector, doubt: OwnDoubt) -> VelocityBySight:
        """Return what is made of it at the tick of `time` [s]; the correction holds from then.

        v: (3,) m/s, the velocity now. doubt: of the own state, as told.
        """
        mean, p = self._predicted(time, doubt, _SCALE)
        east, north, _ = v.tolist()
        h = np.array([[1.0, 0.0, -north], [0.0, 1.0, east]])
        sigma = math.sqrt(float(np.linalg.eigvalsh(h @ p[:3, :3] @ h.T)[1]))
        error_east, error_north, turn = mean[:3].tolist()
        error = np.array([error_east, error_north, 0.0])
        shown = sigma if time - self._time < _SHORT else math.inf
        found = VelocityBySight(turn, error, sigma, math.sqrt(float(p[2, 2])), shown)
        self._made.append((time, found))
        return found

    def _predicted(self, time: float, doubt: OwnDoubt, scale: float) -> tuple[Vector, Vector]:
        """Return mean (6,) and covariance (6,6) at `time` [s].

        scale: 1 σ of the share by which the flow is too long.
        """
        velocity = doubt.velocity * doubt.velocity
        tilt = doubt.tilt * doubt.tilt
        prior = np.array([velocity, velocity, doubt.yaw * doubt.yaw, scale * scale, tilt, tilt])
        if self._covariance is None:
            return self._mean, np.diag(prior)
        gap = max(time - self._time, 0.0)
        lasts = _LONG if self._wrong else _SHORT
        times = np.array([lasts, lasts, _HEADING_LASTS, _LONG, ATTITUDE_TIME, ATTITUDE_TIME])
        kept = np.exp(-gap / times)
        grown = prior * (1.0 - kept**2)
        grown[:2] += self._wrong * (1.0 - math.exp(-2.0 * gap / _SHORT))
        return kept * self._mean, kept[:, None] * self._covariance * kept + np.diag(grown)

    def _jump(self, error: Vector, time: float, noise: Vector) -> Vector:
        """Return the covariance (2,2) m²/s² of which a jump tells, beyond a flow's `noise`.

        error: (2,) m/s, of the told velocity by the flow at `time` [s].
        """
        last, self._last = self._last, (time, error)
        if last is None or time - last[0] > _AVERAGED:
            return np.zeros((2, 2))
        jump = error - last[1]
        square = float(jump @ np.linalg.solve(2.0 * noise, jump))
        beyond = max(0.0, 1.0 - _JUMP_SIGMAS**2 / max(square, 1e-9))
        return 0.5 * beyond * np.outer(jump, jump)

    def _notice(self, off: Vector, expected: Vector, dt: float) -> None:
        """Take in an innovation (2,) m/s of covariance `expected` after dt [s].

        Innovations of a filter that is right are white: their mean is beyond their noise where the
        velocity is more wrong than the filter thinks.
        """
        share = 1.0 - math.exp(-dt / _AVERAGED)
        self._innovation = self._innovation + share * (off - self._innovation)
        if self._spread is None:
            self._spread = share / (2.0 - share) * expected
        else:
            self._spread = (1.0 - share) ** 2 * self._spread + share**2 * expected
        square = float(self._innovation @ np.linalg.solve(self._spread, self._innovation))
        beyond = max(0.0, 1.0 - _SURE**2 / max(square, 1e-9))
        self._wrong = beyond * (_FOLLOWED * norm(self._innovation)) ** 2

    def _at(self, time: float) -> VelocityBySight:
        """Return the correction that held at `time` [s]."""
        for since, made in reversed(self._made):
            if since <= time:
                return made
        return VelocityBySight()


def _noise(v: Vector, scale: float) -> Vector:
    """Return the covariance (2,2) m²/s² of a flow at the velocity v (2,) m/s.

    scale: m/s, height over the time between the pictures.
    """
    u = v / max(norm(v), _SLOWEST)
    along, across = (_ALONG * scale) ** 2, (_ACROSS * scale) ** 2
    noise: Vector = across * _LEVEL + (along - across) * (u[:, None] * u)
    return noise


def _shifted(before: Vector, after: Vector) -> Vector:
    """Return by how much (2,2) ground of height 1 m moves in pictures between two attitudes (4,).

    Columns: where the told attitude leans so that the ground shows 1 m too far ahead, or left.
    """
    begin = yaw_of(before)
    half = 0.5 * math.remainder(yaw_of(after) - begin, math.tau)
    turned = _SHIFT[:, None] * (_rotation(-half) - _rotation(half))
    shift: Vector = _rotation(begin + half) @ turned
    return shift


def _rotation(angle: float) -> Vector:
    """Return the rotation (2,2) to the left by `angle` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _turned(v: Vector, angle: float) -> Vector:
    """Return a vector (3,) turned left by `angle` [rad] about the vertical."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = v.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])
