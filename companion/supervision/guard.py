"""Guard: the last check before the wire; any input, NaN included, gives a finite, bounded command.

`Guard.judge` is total. Of these rules the first that applies gives the command; the last one, which
supervision applies to it, may replace what comes from a plan:

| rule | what | command | request |
|---|---|---|---|
| 1 | telemetry silent | stop turning, hover thrust | HOLD, LAND, silence: `stale_…` |
| 2 | attitude or position not plausible | level, hover thrust | LAND |
| 3 | a stage of the tick failed | brake | HOLD |
| 4 | ticks late | brake gently | as by rules 3 to 9 |
| 5 | no usable plan | `shifted_max` times the last, shifted; then brake | LAND: `bad_land` |
| 6 | outside the fence | brake | LAND beyond `fence_land` |
| 7 | an assumption is broken (`monitors.py`) | brake, or climb | HOLD, where it is grave |
| 8 | camera blind | brake to `blind_speed`; hover: `blind_hover`, misled | HOLD: `blind_hold` |
| 9 | an assumption is broken, but not gravely | brake to `blind_speed` | |
| 10 | else | the plan, clipped | |
| 11 | the plan has no certificate (`certify.py`) | a way that has, or keeps most room | |

Where more than `lost` of the telemetry is lost, setpoints are, too. Each is sent three times, so
that a plan still flies (reason `lossy` instead of `plan`), and after `lost_hold` HOLD is requested
by any rule that requests nothing. Braking meanwhile was worse: it evades nobody.

Where the autopilot's position is less sure than `hold_doubt`, LAND is requested instead of HOLD.
Braking and levelling are laws in closed form, without any solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum

import numpy as np

from companion.supervision.braking import brake, brake_late, level
from companion.supervision.guard_config import GuardConfig
from companion.types import Plan
from mavlink_bridge.shared.arrays import Vector, finite, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import RateCommand, VehicleState

_CLIMB = 0.5  # m/s, where the ground is too near


class Reason(Enum):
    """The rule that gave a command."""

    FAILURE = "failure"  # 3: a stage of the tick failed
    NO_STATE = "no_state"  # 1: telemetry is silent
    BAD_STATE = "bad_state"  # 2: attitude or position not plausible
    LATE = "late"  # 4: ticks do not come in time
    SHIFTED_PLAN = "shifted_plan"  # 5: no usable plan
    BRAKE = "brake"  # 5: no usable plan for longer
    FENCE = "fence"  # 6
    BLIND = "blind"  # 8
    PLAN = "plan"  # 10
    ASSUMPTION = "assumption"  # 7 and 9: what the flight assumes does not hold
    UNCERTIFIED = "uncertified"  # 11: what rules 5, 8, 9, 10 want has no certificate
    LOSSY = "lossy"  # 10, while setpoints get lost


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
    does not hold. acting: state at which this tick's command takes effect; None: as own. wind: (3,)
    m/s², world, acceleration that the model does not explain; None: not known.
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
    wind: Vector | None = None


@dataclass(frozen=True)
class Verdict:
    """The command to send, its reason, the ticks in a row without a sound plan, and a request."""

    command: RateCommand
    reason: Reason
    bad_ticks: int
    request: AutopilotRequest = AutopilotRequest.NONE


class Guard:
    """Judges each tick; remembers since when plans, ticks and the link have failed."""

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
            command = _brake(s, own, self._config)
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
        verdict = self._lossy(s, verdict)
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
        """Rule 4: brake gently where ticks are late; None elsewhere."""
        c = self._config
        if self._late_ticks < 2 and not s.tick_gap > 2 * c.late:
            return None
        return self._verdict(brake_late(own, c, s.tick_gap), Reason.LATE, request)

    def _lossy(self, s: GuardInputs, verdict: Verdict) -> Verdict:
        """Return the verdict, with the reason and the request that lost setpoints give it."""
        c = self._config
        # The share of one second wavers: what began above `lost` is over below half of it.
        if not s.packet_loss > (c.lost if self._lossy_since is None else 0.5 * c.lost):
            self._lossy_since = None
            return verdict
        if self._lossy_since is None:
            self._lossy_since = s.time
        if verdict.reason is Reason.PLAN:
            verdict = replace(verdict, reason=Reason.LOSSY)
        lasts = s.time - self._lossy_since >= c.lost_hold - 1e-6
        if lasts and verdict.request is AutopilotRequest.NONE:
            verdict = replace(verdict, request=AutopilotRequest.HOLD)
        return verdict

    def _without_plan(self, s: GuardInputs, own: VehicleState) -> Verdict:
        """Rule 5: fly the previous plan, shifted, for a few ticks; then brake."""
        r = s.plan
        over = s.time - self._bad_since >= self._config.bad_land - 1e-6
        request = AutopilotRequest.LAND if over else AutopilotRequest.NONE
        if r is not None and self._bad_ticks <= self._config.shifted_max and finite(r.u[0]):
            return self._verdict(self._bounded(r.u[0]), Reason.SHIFTED_PLAN, request)
        return self._verdict(_brake(s, own, self._config), Reason.BRAKE, request)

    def _outside_fence(self, s: GuardInputs, own: VehicleState) -> Verdict | None:
        """Rule 6: brake outside the fence, unless the plan leads back; None elsewhere."""
        c = self._config
        if s.outside > c.fence_land:
            return self._verdict(_brake(s, own, c), Reason.FENCE, AutopilotRequest.LAND)
        if s.outside > 0.0 and s.outward > c.fence_drift:
            return self._verdict(_brake(s, own, c), Reason.FENCE)
        return None

    def _gravely_broken(self, s: GuardInputs, own: VehicleState) -> Verdict | None:
        """Rule 7: brake or climb where the flight assumes what does not hold; None elsewhere."""
        if s.broken is None or s.broken.reaction is Reaction.SLOW:
            return None
        if s.broken.reaction is Reaction.CLIMB:
            acting = _acting(s, own)
            sinks = replace(acting, v=acting.v - np.array([0.0, 0.0, _CLIMB]))
            return self._verdict(brake(sinks, self._config, _wind(s)), Reason.ASSUMPTION)
        command = _brake(s, own, self._config)
        if s.broken.reaction is Reaction.HOVER:
            return self._verdict(command, Reason.ASSUMPTION)
        return self._verdict(command, Reason.ASSUMPTION, AutopilotRequest.HOLD)

    def _broken(self, s: GuardInputs, own: VehicleState, plan: Plan) -> Verdict | None:
        """Rule 9: fly slowly where an assumption may not hold; None elsewhere."""
        if s.broken is None:
            return None
        fast = norm(own.v) > self._config.blind_speed
        command = _brake(s, own, self._config) if fast else self._bounded(plan.u[0])
        return self._verdict(command, Reason.ASSUMPTION)

    def _blind(self, s: GuardInputs, own: VehicleState, plan: Plan) -> Verdict | None:
        """Rule 8: fly slowly, then hover, while the camera has a fault; None elsewhere."""
        c = self._config
        if not s.blind > 0.0:
            return None
        fast = norm(own.v) > c.blind_speed
        request = AutopilotRequest.HOLD if s.blind > c.blind_hold else AutopilotRequest.NONE
        if fast or s.misled or s.blind > c.blind_hover:
            return self._verdict(_brake(s, own, c), Reason.BLIND, request)
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


def _acting(s: GuardInputs, own: VehicleState) -> VehicleState:
    """Return the state to brake from: a command that turns the frame late makes it swing."""
    return own if s.acting is None or not _state_finite(s.acting) else s.acting


def _brake(s: GuardInputs, own: VehicleState, config: GuardConfig) -> RateCommand:
    return brake(_acting(s, own), config, _wind(s))


def _wind(s: GuardInputs) -> Vector:
    """Return the acceleration (3,) m/s² that a brake makes up for; its estimate is bounded."""
    return np.zeros(3) if s.wind is None or not finite(s.wind) else s.wind


def _usable(plan: Plan | None) -> Plan | None:
    """Return a plan of this tick with a finite first input; None where there is none."""
    good = plan is not None and plan.usable and finite(plan.u[0])
    return plan if good else None


def _state_finite(own: VehicleState) -> bool:
    return all(finite(a) for a in (own.p, own.v, own.q_wb, own.omega))
