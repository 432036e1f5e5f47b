"""Guard: the last check before the wire; any input, NaN included, gives a finite, bounded command.

`Guard.judge` is total. Of these rules the first that applies gives the command; the last one, which
supervision applies to it, may replace what comes from a plan:

| rule | what | command | request |
|---|---|---|---|
| 1 | telemetry silent | stop turning, hover thrust | HOLD, LAND, silence: `stale_…` |
| 2 | attitude or position not plausible | level, hover thrust | LAND |
| 3 | a stage of the tick failed | brake | HOLD |
| 4 | ticks late, or setpoints lost | brake gently | as by rules 3 to 9, or HOLD: `lost_hold` |
| 5 | no usable plan | `shifted_max` times the last, shifted; then brake | LAND: `bad_land` |
| 6 | outside the fence | brake | LAND beyond `fence_land` |
| 7 | an assumption is broken (`monitors.py`) | brake, or climb | HOLD, where it is grave |
| 8 | camera blind | brake to `blind_speed`; hover: `blind_hover`, misled | HOLD: `blind_hold` |
| 9 | an assumption is broken, but not gravely | brake to `blind_speed` | |
| 10 | else | the plan, clipped | |
| 11 | the plan has no certificate (`certify.py`) | a way that has, or keeps most room | |

Where the autopilot's position is less sure than `hold_doubt`, LAND is requested instead of HOLD.
Braking and levelling are laws in closed form, without any solver.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from companion.types import Plan
from mavlink_bridge.shared.arrays import Vector, finite, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import integrate, rotation_matrix
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from mavlink_bridge.wire.messages import RateCommand, VehicleState

# s that shifted plans and braking may last before the watchdog takes the companion for dead
FALLBACK_MAX = 2.5
_LATE_GAIN = 0.7  # of the error, per command: 1 would be dead-beat
_LATE_BRAKE = 0.25  # of the attitude's gain
_UNTIL_TURNED = 0.1  # s, from a command's effect until the frame has turned most of its way
_UNTIL_ACTING = 0.75  # share of the time between late commands before a command acts
_LOSSY_HELD = 0.3  # s that a command is in force where half of them are lost
_CLIMB = 0.5  # m/s, where the ground is too near
_TURN_MAX = 0.5  # s; the body rates of the last command are assumed for no longer


class Reason(Enum):
    """The rule that gave a command."""

    FAILURE = "failure"  # 3: a stage of the tick failed
    NO_STATE = "no_state"  # 1: telemetry is silent
    BAD_STATE = "bad_state"  # 2: attitude or position not plausible
    LATE = "late"  # 4: ticks do not come in time, or setpoints get lost
    SHIFTED_PLAN = "shifted_plan"  # 5: no usable plan
    BRAKE = "brake"  # 5: no usable plan for longer
    FENCE = "fence"  # 6
    BLIND = "blind"  # 8
    PLAN = "plan"  # 10
    ASSUMPTION = "assumption"  # 7 and 9: what the flight assumes does not hold
    UNCERTIFIED = "uncertified"  # 11: what rules 5, 8, 9, 10 want has no certificate


class Reaction(IntEnum):
    """What the drone does where an assumption is broken, weakest first."""

    SLOW = 1  # fly the plan slowly
    HOVER = 2  # brake
    CLIMB = 3  # brake and climb
    HOLD = 4  # brake and request HOLD


@dataclass(frozen=True)
class Broken:
    """An assumption that does not hold: what was found, and what the drone does about it."""

    finding: str
    reaction: Reaction


class AutopilotRequest(Enum):
    """What the autopilot is asked to do."""

    NONE = "nothing"
    HOLD = "hold"
    LAND = "land"
    SILENCE = "silence"  # no setpoint is sent, so that its own failsafe takes over


class GuardConfig(StrictModel):
    """Bounds and thresholds."""

    omega_max: float = Field(3.0, ge=0.5, description="Highest body rate [rad/s], each axis.")
    c_min: float = Field(2.0, ge=0, lt=GRAVITY, description="Least collective acceleration [m/s²].")
    c_max: float = Field(20.0, gt=GRAVITY, description="Most collective acceleration [m/s²].")
    shifted_max: int = Field(
        2, ge=0, description="Ticks that a shifted plan may fly: the third bad solve brakes."
    )
    bad_land: float = Field(
        2.0,
        gt=0,
        lt=FALLBACK_MAX,
        description="Time [s] without a usable plan after which LAND is requested: a solver that "
        "has failed for so long does not recover.",
    )
    stale_predict: float = Field(
        0.15,
        gt=0,
        description="Age [s] of telemetry from which the model predicts the state. At 50 Hz: 7 "
        "samples lost.",
    )
    stale_stop: float = Field(
        0.3,
        gt=0,
        description="Age [s] of telemetry from which there is no state: stop turning, request "
        "HOLD. The drone flies 0.5 m meanwhile.",
    )
    stale_land: float = Field(
        1.0, gt=0, description="Age [s] of telemetry from which LAND is requested."
    )
    stale_silent: float = Field(
        2.0,
        gt=0,
        description="Age [s] of telemetry from which no setpoint is sent: the autopilot's own "
        "failsafe lands the drone.",
    )
    fence_land: float = Field(
        1.0,
        ge=0,
        description="Distance [m] outside the fence beyond which LAND is requested; the drone "
        "stops within 1 m more.",
    )
    fence_drift: float = Field(
        0.2,
        ge=0,
        description="Outward speed [m/s] outside the fence up to which the plan flies: it leads "
        "back.",
    )
    blind_speed: float = Field(
        0.4, gt=0, description="Highest speed [m/s] while the camera has a fault."
    )
    blind_hover: float = Field(
        1.4, gt=0, description="Time [s] of a camera fault after which the drone brakes and hovers."
    )
    blind_hold: float = Field(
        5.0,
        gt=0,
        description="Time [s] of a camera fault after which HOLD is requested: the guard's braking "
        "drifts, the autopilot's hold does not.",
    )
    hold_doubt: float = Field(
        0.4,
        gt=0,
        description="1 σ [m] of the autopilot's position from which LAND is requested instead of "
        "HOLD: a drone that is held by such a position drifts into what it kept clear of.",
    )
    late: float = Field(
        0.15,
        gt=0,
        description="Time [s] for which a command may be in force. Twice in a row longer is late: "
        "body rates meant for 0.1 s turn the drone too far in 0.2 s.",
    )
    lossy: float = Field(
        0.05,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second above which each setpoint is sent three "
        "times. Where half of all packets are lost, a setpoint is then held for 0.5 s every 7 "
        "minutes, not every 2 s.",
    )
    lost: float = Field(
        0.4,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second above which the plan does not fly: as "
        "many setpoints are lost.",
    )
    lost_hold: float = Field(
        1.0, gt=0, description="Time [s] of such a loss after which HOLD is requested."
    )
    brake_gain: float = Field(4.5, gt=0, description="Deceleration per speed [1/s].")
    brake_max: float = Field(6.0, gt=0, description="Most horizontal deceleration [m/s²]: 31°.")
    attitude_gain: float = Field(
        6.0,
        gt=0,
        description="Body rate per attitude error [1/s]: most of it is gone when the next command "
        "acts, and a delay that is known wrongly by 60 ms makes no swing.",
    )

    @model_validator(mode="after")
    def _check_ages(self) -> Self:
        """Refuse ages of which a stronger reaction comes before a milder one."""
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

    time: s, of the tick. plan: this tick's plan, if any. own: state now. age: s, of the telemetry;
    below 0 it is of the future, and counts as stale.
    plausible: attitude and position can be those of a flying drone. outside: m beyond the fence
    (< 0: within); outward: m/s across it. blind: s that the camera has had a fault. tick_gap: s
    that the last command was in force; 0: this is the first. packet_loss: share 0…1 of lost
    telemetry. misled: the camera does not fit, so that what it showed and the plan are wrong.
    failure: a stage of this tick failed, in words; empty: none. broken: the gravest assumption that
    does not hold. acting: state at which this tick's command takes effect; None: as own.
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
    misled: bool = False
    failure: str = ""
    broken: Broken | None = None
    acting: VehicleState | None = None


@dataclass(frozen=True)
class Verdict:
    """The command to send, its reason, the ticks in a row without a sound plan, and a request."""

    command: RateCommand
    reason: Reason
    bad_ticks: int
    request: AutopilotRequest = AutopilotRequest.NONE


class Guard:
    """Judges each tick; remembers since when plans have failed, and ticks or setpoints have."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._bad_ticks = 0
        self._bad_since = 0.0
        self._late_ticks = 0
        self._lossy_since: float | None = None

    def judge(self, s: GuardInputs) -> Verdict:
        """Return the verdict of this tick by the rules of the table above; one call a tick."""
        plan, own = _usable(s.plan), self._known(s)
        self._count(s, sound=plan is not None and own is not None and s.plausible)
        if own is None:
            return self._silent(s)  # rule 1
        if not s.plausible:
            return self._implausible(own)  # rule 2
        if s.failure:
            command = brake(_acting(s, own), self._config)
            verdict = self._verdict(command, Reason.FAILURE, AutopilotRequest.HOLD)
        elif plan is None:
            verdict = self._without_plan(s, own)  # rule 5
        else:
            verdict = (
                self._outside_fence(s, own)  # rule 6
                or self._gravely_broken(s, own)  # rule 7
                or self._blind(s, own, plan)  # rule 8
                or self._broken(s, own, plan)  # rule 9
                or self._verdict(self._bounded(plan.u[0]), Reason.PLAN)  # rule 10
            )
        # Rule 4 replaces the command of the rules after it and keeps their request.
        return self._late(s, own, verdict.request) or verdict

    def _known(self, s: GuardInputs) -> VehicleState | None:
        """Return the own state; None where telemetry is silent or not finite."""
        stale = not 0.0 <= s.age <= self._config.stale_stop
        return s.own if s.own is not None and _state_finite(s.own) and not stale else None

    def _count(self, s: GuardInputs, sound: bool) -> None:
        """Count the ticks in a row that came late, and those without a sound plan and state."""
        self._late_ticks = self._late_ticks + 1 if s.tick_gap > self._config.late else 0
        if sound:
            self._bad_ticks = 0
        else:
            self._bad_since = s.time if self._bad_ticks == 0 else self._bad_since
            self._bad_ticks += 1

    def _silent(self, s: GuardInputs) -> Verdict:
        """Rule 1: stop turning; an age that is not a number counts as a long one."""
        c = self._config
        request = AutopilotRequest.LAND if s.age > c.stale_land else AutopilotRequest.HOLD
        if not s.age <= c.stale_silent:
            request = AutopilotRequest.SILENCE
        return self._verdict(RateCommand(np.zeros(3), GRAVITY), Reason.NO_STATE, request)

    def _implausible(self, own: VehicleState) -> Verdict:
        """Rule 2: level the frame."""
        return self._verdict(level(own, self._config), Reason.BAD_STATE, AutopilotRequest.LAND)

    def _late(self, s: GuardInputs, own: VehicleState, request: AutopilotRequest) -> Verdict | None:
        """Rule 4: brake gently where ticks are late or setpoints get lost; None elsewhere."""
        c = self._config
        lossy = self._lossy(s)
        if not lossy and self._late_ticks < 2 and not s.tick_gap > 2 * c.late:
            return None
        if lossy > c.lost_hold and request is AutopilotRequest.NONE:
            request = AutopilotRequest.HOLD
        held = max(s.tick_gap, _LOSSY_HELD if lossy else 0.0)
        return self._verdict(brake_late(own, c, held), Reason.LATE, request)

    def _lossy(self, s: GuardInputs) -> float:
        """Return since how many seconds too much is lost, this tick included; 0: it is not."""
        if not s.packet_loss > self._config.lost:
            self._lossy_since = None
            return 0.0
        if self._lossy_since is None:
            self._lossy_since = s.time
        return s.time - self._lossy_since + 1e-3

    def _without_plan(self, s: GuardInputs, own: VehicleState) -> Verdict:
        """Rule 5: fly the previous plan, shifted, for a few ticks; then brake."""
        r = s.plan
        over = s.time - self._bad_since >= self._config.bad_land - 1e-6
        request = AutopilotRequest.LAND if over else AutopilotRequest.NONE
        if r is not None and self._bad_ticks <= self._config.shifted_max and finite(r.u[0]):
            return self._verdict(self._bounded(r.u[0]), Reason.SHIFTED_PLAN, request)
        return self._verdict(brake(_acting(s, own), self._config), Reason.BRAKE, request)

    def _outside_fence(self, s: GuardInputs, own: VehicleState) -> Verdict | None:
        """Rule 6: brake outside the fence, unless the plan leads back; None elsewhere."""
        c = self._config
        if s.outside > c.fence_land:
            return self._verdict(brake(_acting(s, own), c), Reason.FENCE, AutopilotRequest.LAND)
        if s.outside > 0.0 and s.outward > c.fence_drift:
            return self._verdict(brake(_acting(s, own), c), Reason.FENCE)
        return None

    def _gravely_broken(self, s: GuardInputs, own: VehicleState) -> Verdict | None:
        """Rule 7: brake or climb where the flight assumes what does not hold; None elsewhere."""
        if s.broken is None or s.broken.reaction is Reaction.SLOW:
            return None
        if s.broken.reaction is Reaction.CLIMB:
            acting = _acting(s, own)
            sinks = replace(acting, v=acting.v - np.array([0.0, 0.0, _CLIMB]))
            return self._verdict(brake(sinks, self._config), Reason.ASSUMPTION)
        command = brake(_acting(s, own), self._config)
        if s.broken.reaction is Reaction.HOVER:
            return self._verdict(command, Reason.ASSUMPTION)
        return self._verdict(command, Reason.ASSUMPTION, AutopilotRequest.HOLD)

    def _broken(self, s: GuardInputs, own: VehicleState, plan: Plan) -> Verdict | None:
        """Rule 9: fly slowly where an assumption may not hold; None elsewhere."""
        if s.broken is None:
            return None
        fast = norm(own.v) > self._config.blind_speed
        command = brake(_acting(s, own), self._config) if fast else self._bounded(plan.u[0])
        return self._verdict(command, Reason.ASSUMPTION)

    def _blind(self, s: GuardInputs, own: VehicleState, plan: Plan) -> Verdict | None:
        """Rule 8: fly slowly, then hover, while the camera has a fault; None elsewhere."""
        c = self._config
        if not s.blind > 0.0:
            return None
        fast = norm(own.v) > c.blind_speed
        request = AutopilotRequest.HOLD if s.blind > c.blind_hold else AutopilotRequest.NONE
        if fast or s.misled or s.blind > c.blind_hover:
            return self._verdict(brake(_acting(s, own), c), Reason.BLIND, request)
        return self._verdict(self._bounded(plan.u[0]), Reason.BLIND, request)

    def _verdict(
        self,
        command: RateCommand,
        reason: Reason,
        request: AutopilotRequest = AutopilotRequest.NONE,
    ) -> Verdict:
        return Verdict(command, reason, self._bad_ticks, request)

    def _bounded(self, u: Vector) -> RateCommand:
        """Return an input u (4,) c, omega as a command within the bounds."""
        c = self._config
        omega = np.minimum(np.maximum(u[1:4], -c.omega_max), c.omega_max)
        return RateCommand(omega, min(max(float(u[0]), c.c_min), c.c_max))


def brake(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Return the command that brakes: tilt against the velocity, thrust for the height.

    The wanted specific force is −gain·v + g e_z, bounded; v is the velocity when the frame can have
    turned, as its present tilt goes on accelerating it until then.
    """
    tilted = GRAVITY * rotation_matrix(own.q_wb)[:, 2]
    then = own.v + _UNTIL_TURNED * np.array([tilted[0], tilted[1], 0.0])
    return _towards(_against(then, config.brake_gain, config.brake_gain, config), own, config)


def brake_late(own: VehicleState, config: GuardConfig, held: float) -> RateCommand:
    """Return the command that brakes, with gains low enough for a command held for `held` [s].

    The body rates of the last command go on turning the frame until this one acts.
    """
    q_then = integrate(own.q_wb, own.omega, min(held, _TURN_MAX) * _UNTIL_ACTING)
    gain = min(_LATE_GAIN / held, config.attitude_gain)
    force = _against(own.v, min(_LATE_BRAKE * gain, config.brake_gain), gain, config)
    slower = config.model_copy(update={"attitude_gain": gain})
    return _towards(force, replace(own, q_wb=q_then), slower)


def _against(v: Vector, horizontal: float, vertical: float, config: GuardConfig) -> Vector:
    """Return the specific force (3,) [m/s²; world] that brakes v (3,) m/s by these gains [1/s]."""
    sideways = -horizontal * v[:2]
    size = float(np.hypot(*sideways))
    if size > config.brake_max:
        sideways = sideways * (config.brake_max / size)
    up = float(np.clip(-vertical * v[2], -3.0, 3.0))
    return np.array([sideways[0], sideways[1], GRAVITY + up])


def level(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Return the command that levels the frame and carries the weight; only q_wb is used."""
    return _towards(np.array([0.0, 0.0, GRAVITY]), own, config)


def _towards(force: Vector, own: VehicleState, config: GuardConfig) -> RateCommand:
    """Return the command that turns the thrust towards a specific force (3,) [m/s²; world].

    The attitude error is the rotation between the body's z axis and the force; the thrust is the
    part of the force along that axis.
    """
    r = rotation_matrix(own.q_wb)
    wanted = r.T @ (force / norm(force))  # in the body frame
    error = np.cross([0.0, 0.0, 1.0], wanted)
    if wanted[2] < 0.0:  # more than 90° off: turn at full rate
        error = error / max(norm(error), 1e-6)
    omega = np.clip(config.attitude_gain * error, -config.omega_max, config.omega_max)
    c = float(np.clip(force @ r[:, 2], config.c_min, config.c_max))
    if not (finite(omega) and np.isfinite(c)):  # numbers too large to be squared
        return RateCommand(np.zeros(3), GRAVITY)
    return RateCommand(omega, c)


def _acting(s: GuardInputs, own: VehicleState) -> VehicleState:
    """Return the state to brake from: a command that turns the frame late makes it swing."""
    return own if s.acting is None or not _state_finite(s.acting) else s.acting


def _usable(plan: Plan | None) -> Plan | None:
    """Return a plan of this tick with a finite first input; None where there is none."""
    good = plan is not None and plan.usable and finite(plan.u[0])
    return plan if good else None


def _state_finite(own: VehicleState) -> bool:
    return all(finite(a) for a in (own.p, own.v, own.q_wb, own.omega))
