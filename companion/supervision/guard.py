"""The last word before the wire: any input, NaN included, gives a finite, bounded command.

`Guard.judge` is total and is the only source of commands. Rules, the first that applies:

| what | command | asks |
|---|---|---|
| telemetry silent | stop turning, hover thrust | HOLD, LAND, silence: `stale_…` |
| attitude or position not to be believed | level, hover thrust | LAND |
| no usable plan | `shifted_max` times the last, shifted; then brake | LAND: `bad_land` |
| outside the fence | brake | LAND beyond `fence_land` |
| camera blind | brake, fly on at `blind_speed`, hover after `blind_hover` | HOLD: `blind_hold` |
| ticks come late, or commands get lost | brake, as gently as that allows | HOLD: `lost_hold` |
| else | the plan, clipped | |

Braking and levelling are laws in closed form, without any solver.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from enum import Enum
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from companion.types import Plan
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import integrate, rotation_matrix
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from mavlink_bridge.shared.thrust import G
from mavlink_bridge.wire.messages import RateCommand, VehicleState

# s that shifted plans and braking may last before the watchdog takes the companion for dead
FALLBACK_MAX = 2.5
_LATE_GAIN = 0.7  # of the error, per command: 1 would be dead-beat
_LATE_BRAKE = 0.25  # of the attitude's gain
_ON_THE_WAY = 0.75  # share of the time between late commands before one acts
_LOST_HELD = 0.3  # s, of commands of which half are lost: most are in force no longer
_LATEST = 0.5  # s; nobody turns on as before for longer


class Reason(Enum):
    """Why a command is what it is."""

    PLAN = "plan"
    SHIFTED_PLAN = "shifted_plan"
    BRAKE = "brake"  # no usable plan
    NO_STATE = "no_state"  # telemetry is silent
    BAD_STATE = "bad_state"  # attitude or position not to be believed
    FENCE = "fence"
    BLIND = "blind"
    LATE = "late"  # ticks do not come in time, or commands get lost


class AutopilotRequest(Enum):
    """What the autopilot is to do about it."""

    NONE = "nothing"
    HOLD = "hold"
    LAND = "land"
    SILENCE = "silence"  # nothing: its own failsafe is to take over, so no setpoint is sent


class GuardConfig(StrictModel):
    """Bounds and thresholds."""

    omega_max: float = Field(3.0, ge=0.5, description="Each body rate [rad/s].")
    c_min: float = Field(2.0, ge=0, lt=9.81, description="m/s².")
    c_max: float = Field(20.0, gt=9.81, description="m/s².")
    shifted_max: int = Field(
        2, ge=0, description="Ticks that a shifted plan may fly: the third bad solve brakes."
    )
    bad_land: float = Field(
        2.0,
        gt=0,
        lt=FALLBACK_MAX,
        description="No usable plan for this long [s]: LAND; a solver does not recover.",
    )
    stale_predict: float = Field(
        0.15,
        gt=0,
        description="Telemetry older [s]: state by the model. At 50 Hz: 7 lost.",
    )
    stale_stop: float = Field(
        0.3, gt=0, description="Older [s]: no state; stop turning, ask for HOLD. 0.5 m of flight."
    )
    stale_land: float = Field(1.0, gt=0, description="Older [s]: ask for LAND.")
    stale_silent: float = Field(
        2.0, gt=0, description="Older [s]: end the stream; the autopilot's own failsafe lands it."
    )
    fence_land: float = Field(
        1.0, ge=0, description="Farther outside the fence [m]: LAND; it stops 1 m farther at most."
    )
    fence_drift: float = Field(
        0.2, ge=0, description="Outward speed [m/s] that is free outside: the plan leads back."
    )
    blind_speed: float = Field(0.4, gt=0, description="Without eyes not faster than this [m/s].")
    blind_hover: float = Field(1.4, gt=0, description="Blind for longer [s]: brake and hover.")
    blind_hold: float = Field(
        5.0, gt=0, description="Blind for longer [s]: ask for HOLD; this law drifts, that one not."
    )
    late: float = Field(
        0.15,
        gt=0,
        description="Commands held longer [s], twice on end: rates for 0.1 s turn too far in 0.2.",
    )
    lossy: float = Field(
        0.05,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second: each setpoint is sent three times. Where "
        "half of all packets are lost, one is then held for 0.5 s every 7 minutes, not every 2 s.",
    )
    lost: float = Field(
        0.4,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second: of commands too; the plan does not fly.",
    )
    lost_hold: float = Field(1.0, gt=0, description="Lost for longer [s]: ask for HOLD.")
    brake_gain: float = Field(3.5, gt=0, description="Deceleration per speed [1/s].")
    brake_max: float = Field(6.0, gt=0, description="Most horizontal deceleration [m/s²]: 31°.")
    attitude_gain: float = Field(
        9.0, gt=0, description="Rate per attitude error [1/s]; with brake_gain: damping 0.8."
    )

    @model_validator(mode="after")
    def _ages_in_order(self) -> Self:
        """Each answer to stale telemetry comes after the milder one."""
        names = ("stale_predict", "stale_stop", "stale_land", "stale_silent")
        for mild, strong in itertools.pairwise(names):
            before, after = getattr(self, mild), getattr(self, strong)
            if not before < after:
                text = f"{strong}, {after:g}, must be above {mild}, {before:g}"
                raise Contradiction((strong, mild), text)
        return self


@dataclass(frozen=True)
class GuardInputs:
    """What a verdict depends on, besides the guard's memory.

    time: s, of the tick. plan: this tick's plan, if any. own: state now. age: s, of the telemetry.
    plausible: attitude and position can be those of a flying drone. outside: m beyond the fence
    (< 0: within); outward: m/s across it. blind: s that the camera has had a fault. tick_gap: s
    that the last command was in force; 0: this is the first. packet_loss: share 0…1 of lost
    telemetry.
    """

    time: float
    plan: Plan | None = None
    own: VehicleState | None = None
    age: float = float("inf")
    plausible: bool = True
    outside: float = float("-inf")
    outward: float = 0.0
    blind: float = 0.0
    tick_gap: float = 0.0
    packet_loss: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """The command to send, why it is that one, how many ticks in a row had no plan, what to ask."""

    command: RateCommand
    reason: Reason
    bad_ticks: int
    request: AutopilotRequest = AutopilotRequest.NONE


class Guard:
    """Total function with a memory of since when it has gone without a plan."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._bad_ticks = 0
        self._bad_since = 0.0
        self._late_ticks = 0
        self._lossy_since: float | None = None

    def judge(self, s: GuardInputs) -> Verdict:
        """The command for this tick; one call a tick."""
        c = self._config
        good = s.plan is not None and s.plan.usable and bool(np.isfinite(s.plan.u[0]).all())
        known = s.own is not None and _finite(s.own) and s.age <= c.stale_stop
        self._late_ticks = self._late_ticks + 1 if s.tick_gap > c.late else 0
        if good and known and s.plausible:
            self._bad_ticks = 0
        else:
            self._bad_since = s.time if self._bad_ticks == 0 else self._bad_since
            self._bad_ticks += 1
        if not known:
            return self._verdict(RateCommand(np.zeros(3), G), Reason.NO_STATE, self._stale(s.age))
        assert s.own is not None
        if not s.plausible:
            return self._verdict(level(s.own, c), Reason.BAD_STATE, AutopilotRequest.LAND)
        verdict = self._with_plan(s, s.own) if good else self._without_plan(s, s.own)
        lossy = self._lossy(s)
        if not lossy and self._late_ticks < 2 and not s.tick_gap > 2 * c.late:
            return verdict
        command = brake_late(s.own, c, max(s.tick_gap, _LOST_HELD if lossy else 0.0))
        hold = lossy > c.lost_hold and verdict.request is AutopilotRequest.NONE
        return self._verdict(
            command, Reason.LATE, AutopilotRequest.HOLD if hold else verdict.request
        )

    def _lossy(self, s: GuardInputs) -> float:
        """Seconds that too much has been lost, this tick included; 0 where it is not."""
        if not s.packet_loss > self._config.lost:
            self._lossy_since = None
            return 0.0
        if self._lossy_since is None:
            self._lossy_since = s.time
        return s.time - self._lossy_since + 1e-3

    def _without_plan(self, s: GuardInputs, own: VehicleState) -> Verdict:
        """The previous plan, shifted, a few times; then no plan at all."""
        r = s.plan
        over = s.time - self._bad_since >= self._config.bad_land - 1e-6
        request = AutopilotRequest.LAND if over else AutopilotRequest.NONE
        if r is not None and self._bad_ticks <= self._config.shifted_max and _all_finite(r.u[0]):
            return self._verdict(self._bounded(r.u[0]), Reason.SHIFTED_PLAN, request)
        return self._verdict(brake(own, self._config), Reason.BRAKE, request)

    def _with_plan(self, s: GuardInputs, own: VehicleState) -> Verdict:
        """The plan, unless the drone has to slow down first."""
        c = self._config
        assert s.plan is not None
        if s.outside > c.fence_land:
            return self._verdict(brake(own, c), Reason.FENCE, AutopilotRequest.LAND)
        if s.outside > 0.0 and s.outward > c.fence_drift:
            return self._verdict(brake(own, c), Reason.FENCE)
        if s.blind > 0.0:
            fast = float(np.linalg.norm(own.v)) > c.blind_speed
            request = AutopilotRequest.HOLD if s.blind > c.blind_hold else AutopilotRequest.NONE
            if fast or s.blind > c.blind_hover:
                return self._verdict(brake(own, c), Reason.BLIND, request)
            return self._verdict(self._bounded(s.plan.u[0]), Reason.BLIND, request)
        return self._verdict(self._bounded(s.plan.u[0]), Reason.PLAN)

    def _stale(self, age: float) -> AutopilotRequest:
        """What silence asks for; an age that is no number is a long one."""
        c = self._config
        if not age <= c.stale_silent:
            return AutopilotRequest.SILENCE
        return AutopilotRequest.LAND if age > c.stale_land else AutopilotRequest.HOLD

    def _verdict(
        self,
        command: RateCommand,
        reason: Reason,
        request: AutopilotRequest = AutopilotRequest.NONE,
    ) -> Verdict:
        return Verdict(command, reason, self._bad_ticks, request)

    def _bounded(self, u: Vector) -> RateCommand:
        c = self._config
        omega = np.clip(u[1:4], -c.omega_max, c.omega_max)
        return RateCommand(omega, float(np.clip(u[0], c.c_min, c.c_max)))


def brake(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Decelerate and hover in closed form: tilt against the velocity, thrust for height.

    The wanted specific force is −gain·v + g e_z, bounded.
    """
    return _towards(_against(own.v, config.brake_gain, config.brake_gain, config), own, config)


def brake_late(own: VehicleState, config: GuardConfig, held: float) -> RateCommand:
    """Brake where commands come late and are held for `held` [s]: every gain fits that.

    The last command has turned the frame on until this one acts, a tick's length before it ends.
    """
    q_then = integrate(own.q_wb, own.omega, min(held, _LATEST) * _ON_THE_WAY)
    gain = min(_LATE_GAIN / held, config.attitude_gain)
    force = _against(own.v, min(_LATE_BRAKE * gain, config.brake_gain), gain, config)
    slower = config.model_copy(update={"attitude_gain": gain})
    return _towards(force, replace(own, q_wb=q_then), slower)


def _against(v: Vector, horizontal: float, vertical: float, config: GuardConfig) -> Vector:
    """(3,) m/s², world: specific force that brakes velocity v (3,) by these gains [1/s]."""
    sideways = -horizontal * v[:2]
    size = float(np.hypot(*sideways))
    if size > config.brake_max:
        sideways = sideways * (config.brake_max / size)
    up = float(np.clip(-vertical * v[2], -3.0, 3.0))
    return np.array([sideways[0], sideways[1], G + up])


def level(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Level the frame and carry the weight: needs an attitude and nothing else."""
    return _towards(np.array([0.0, 0.0, G]), own, config)


def _towards(force: Vector, own: VehicleState, config: GuardConfig) -> RateCommand:
    """Turn the thrust towards a specific force (3,) m/s², world, and give what of it is along.

    The attitude error is the rotation between the body's z axis and the force.
    """
    r = rotation_matrix(own.q_wb)
    wanted = r.T @ (force / np.linalg.norm(force))  # in the body frame
    error = np.cross([0.0, 0.0, 1.0], wanted)
    if wanted[2] < 0.0:  # more than 90° off: turn at full rate
        error = error / max(float(np.linalg.norm(error)), 1e-6)
    omega = np.clip(config.attitude_gain * error, -config.omega_max, config.omega_max)
    c = float(np.clip(force @ r[:, 2], config.c_min, config.c_max))
    if not (_all_finite(omega) and np.isfinite(c)):  # numbers too large to be squared
        return RateCommand(np.zeros(3), G)
    return RateCommand(omega, c)


def _all_finite(values: Vector) -> bool:
    return bool(np.isfinite(values).all())


def _finite(own: VehicleState) -> bool:
    return all(_all_finite(a) for a in (own.p, own.v, own.q_wb, own.omega))
