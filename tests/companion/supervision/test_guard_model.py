"""The guard, checked for every combination of quantised inputs in every state that it can reach.

Its memory is how long plans have failed, ticks have been late and setpoints lost; inputs are taken
on both sides of each threshold, and not a number. What the table in `guard.py` says is written
down a second time here, as conditions on the inputs and on a history that the test keeps itself.
"""

import copy
import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from companion.supervision import guard as module
from companion.supervision.guard import (
    AutopilotRequest,
    Broken,
    Guard,
    GuardInputs,
    Reaction,
    Reason,
)
from companion.supervision.guard_config import GuardConfig
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.supervision.exploring import explore

C = GuardConfig()
NONE, HOLD, LAND, SILENCE = AutopilotRequest
LEVEL, TURNED = np.array([1.0, 0, 0, 0]), np.array([0.0, 1.0, 0, 0])  # upside down
DT = 0.5  # s between ticks in the search; late ticks are told by `tick_gap`


def _own(v, q=LEVEL):
    return VehicleState(0.0, np.array([0.0, 0.0, 2.0]), np.array(v), q, np.array([0.1, -0.2, 0.3]))


def _plan(usable, u):
    return Plan(
        np.zeros((21, 10)), np.tile(u, (20, 1)), PlanStatus.SOLVED, usable, 1, 0.0, 0.0, 0.0, 0.0,
        0.0, (), 0.0,
    )  # fmt: skip


SLOW, FAST = _own((0.1, -0.2, 0.0)), _own((1.5, 0.5, -0.3))
WRONG = {
    "none": None,
    "not a number": _own((np.nan, 0.0, 0.0)),
    "turned over": _own((2.0, 0.0, 0.0), TURNED),
    "huge": _own((1e200, -1e200, 1e300), LEVEL * 1e200),
}
PLANS = {
    "good": _plan(True, (9.0, 0.1, 0.2, 0.3)),
    "beyond the bounds": _plan(True, (1e9, -1e9, 1e9, 7.0)),
    "shifted": _plan(False, (9.5, 0.3, 0.2, 0.1)),
    "not a number": _plan(True, (9.0, np.nan, 0.0, 0.0)),
    "none": None,
}
BRAKES = (Reason.FAILURE, Reason.BRAKE, Reason.FENCE, Reason.ASSUMPTION, Reason.BLIND)
SLOW_DOWN, HOVER, CLIMB, GIVE_BACK = (Broken("found", r) for r in Reaction)
BROKEN = [None, SLOW_DOWN, HOVER, CLIMB, GIVE_BACK]


@dataclass(frozen=True)
class Told:
    """One tick's inputs; the plan by its name."""

    plan: str = "good"
    own: VehicleState | None = SLOW
    age: float = 0.02
    plausible: bool = True
    outside: tuple = (-1.0, 0.0)  # m beyond the fence, m/s across it
    blind: float = 0.0
    misled: bool = False
    tick_gap: float = 0.1
    packet_loss: float = 0.0
    failure: str = ""
    broken: Broken | None = None

    def inputs(self, now):
        more = dict(vars(self))
        outside, outward = more.pop("outside")
        return GuardInputs(now, **more | {"plan": PLANS[self.plan]}, outside=outside,
                           outward=outward)  # fmt: skip


@dataclass
class Checked:
    """A guard, its clock, and its history as the test keeps it."""

    guard: Guard = field(default_factory=lambda: Guard(C))
    now: float = 0.0
    bad: int = 0  # ticks in a row without a sound plan and state
    bad_since: float = 0.0
    late: int = 0  # ticks in a row that came late
    lossy_since: float | None = None

    def __copy__(self):
        return replace(self, guard=copy.copy(self.guard))

    def key(self):
        """What the guard's future depends on."""
        lossy = None if self.lossy_since is None else min(self.now - self.lossy_since, 1.5)
        lasts = min(self.now - self.bad_since, 2.5) if self.bad else 0.0
        return min(self.bad, 3), lasts, min(self.late, 2), lossy

    def tick(self, told):
        """Judge, compare with what the table says, and return the verdict."""
        self.now += DT
        with np.errstate(all="ignore"):  # of numbers too large to be squared
            verdict = self.guard.judge(told.inputs(self.now))
        reason, request = self._expected(told)
        assert (verdict.reason, verdict.request) == (reason, request), told
        assert verdict.bad_ticks == self.bad, told
        self._bounded(told, verdict)
        return verdict

    def _bounded(self, told, verdict):
        omega, c = verdict.command.omega, verdict.command.c
        assert omega.shape == (3,)
        assert all(math.isfinite(w) and abs(w) <= C.omega_max for w in omega.tolist()), told
        assert math.isfinite(c), told
        assert C.c_min <= c <= C.c_max, told
        if verdict.reason is Reason.NO_STATE:
            assert not omega.any(), told
            assert c == GRAVITY, told
        planned = (Reason.PLAN, Reason.LOSSY, Reason.SHIFTED_PLAN)
        if verdict.reason in planned or self._slowly(told, verdict):
            u = np.clip(PLANS[told.plan].u[0], [C.c_min, *[-3.0] * 3], [C.c_max, *[3.0] * 3])
            assert (c, *omega.tolist()) == tuple(u.tolist()), told
        elif told.own is FAST and verdict.reason in BRAKES:
            assert omega[1] < 0.0 < omega[0], told  # nose up, left side up: against the motion

    def _slowly(self, told, verdict):
        """Whether the plan is flown all the same, as the drone is slow."""
        if verdict.reason not in (Reason.BLIND, Reason.ASSUMPTION):
            return False
        hovers = told.misled or told.blind > C.blind_hover
        hovers = hovers if verdict.reason is Reason.BLIND else told.broken is not SLOW_DOWN
        return not hovers and math.hypot(*told.own.v.tolist()) <= C.blind_speed

    def _expected(self, told):
        """Return reason and request by the rules of the table, with the history kept up."""
        known = not any(told.own is o for o in (None, WRONG["not a number"]))
        known = known and 0.0 <= told.age <= C.stale_stop
        good = told.plan in ("good", "beyond the bounds")
        sound = good and known and told.plausible
        if not sound and not self.bad:
            self.bad_since = self.now
        self.bad = 0 if sound else self.bad + 1
        self.late = self.late + 1 if told.tick_gap > C.late else 0
        if not known:
            if not told.age <= C.stale_silent:
                return Reason.NO_STATE, SILENCE
            return Reason.NO_STATE, LAND if told.age > C.stale_land else HOLD
        if not told.plausible:
            return Reason.BAD_STATE, LAND
        lossy = told.packet_loss > (0.5 * C.lost if self.lossy_since else C.lost)
        self.lossy_since = (self.lossy_since or self.now) if lossy else None
        reason, request = self._below(told, good)
        if lossy and request is NONE and self.now - self.lossy_since >= C.lost_hold:
            request = HOLD
        if self.late >= 2 or told.tick_gap > 2 * C.late:
            return Reason.LATE, request
        if lossy and reason is Reason.PLAN:
            reason = Reason.LOSSY
        return reason, request

    def _below(self, told, good):
        """The rules that rule 4 lets decide what is requested."""
        outside, outward = told.outside
        grave = told.broken is not None and told.broken.reaction is not Reaction.SLOW
        over = self.bad and self.now - self.bad_since >= C.bad_land - 1e-6
        shifted = told.plan == "shifted" and self.bad <= C.shifted_max
        rules = [
            (told.failure, Reason.FAILURE, HOLD),
            (not good and shifted, Reason.SHIFTED_PLAN, LAND if over else NONE),
            (not good, Reason.BRAKE, LAND if over else NONE),
            (outside > C.fence_land, Reason.FENCE, LAND),
            (outside > 0.0 and outward > C.fence_drift, Reason.FENCE, NONE),
            (grave and told.broken.reaction is Reaction.HOLD, Reason.ASSUMPTION, HOLD),
            (grave, Reason.ASSUMPTION, NONE),
            (told.blind > 0.0, Reason.BLIND, HOLD if told.blind > C.blind_hold else NONE),
            (told.broken, Reason.ASSUMPTION, NONE),
            (True, Reason.PLAN, NONE),
        ]
        return next((reason, request) for holds, reason, request in rules if holds)


# What the memory depends on: a search over these reaches every state of it.
MEMORY = [
    Told(plan=plan, own=own, plausible=plausible, tick_gap=gap, packet_loss=loss)
    for plan, own, plausible, gap, loss in itertools.product(
        ("good", "shifted", "none"), (SLOW, None), (True, False), (0.1, 0.2), (0.0, 0.3, 0.5)
    )
]
AGES = (-0.01, 0.0, 0.3, 0.31, 1.01, 2.01, math.nan)
OUTSIDE = ((-1.0, 0.0), (0.5, 0.1), (0.5, 1.0), (1.1, -1.0), (math.nan, math.nan))
BLIND = (0.0, 0.1, 2.0, 5.1, math.nan)
GAPS = (0.1, 0.2, 0.4, math.inf, math.nan)


def combinations(plans, owns, outside, blind, gaps, broken):
    """Every combination of these, with fresh telemetry."""
    return [
        Told(plan, own, 0.02, True, out, dark, misled, gap, loss, failure, found)
        for plan, own, out, dark, misled, gap, loss, failure, found in itertools.product(
            plans, owns, outside, blind, (False, True), gaps, (0.0, 0.5), ("", "see: x"), broken
        )
    ]


def untold(plans, gaps, losses, failures):
    """Every combination of these with telemetry that is old, wrong, or none at all."""
    return [
        Told(plan, own, age, plausible, failure=failure, tick_gap=gap, packet_loss=loss)
        for plan, own, age, plausible, failure, gap, loss in itertools.product(
            plans, (SLOW, *WRONG.values()), AGES, (True, False), failures, gaps, losses
        )
    ]


def reachable():
    return explore(Checked(), Checked.key, MEMORY, Checked.tick)


def check(found, told):
    """Judge all inputs in all states; return how many verdicts that were."""
    for state in found.states.values():
        for one in told:
            copy.copy(state).tick(one)
    return len(found.states) * len(told)


def in_short(found):
    """The inputs on one side and the other of what decides, in each state of the memory."""
    few = ((-1.0, 0.0), (0.5, 1.0), (1.1, -1.0))
    broken = (None, SLOW_DOWN, GIVE_BACK)
    told = combinations(
        ("beyond the bounds", "none"), (SLOW, FAST), few, (0.0, 2.0, 5.1), (0.1, 0.4), broken
    )
    told += untold(("good", "none"), (0.1,), (0.0,), ("",))
    ages = {(*s.key()[:1], s.key()[2], s.key()[3] is None): s for s in found.states.values()}
    return check(replace(found, states=ages), told)


def ends_in_a_request(found):
    """What lasts ends in HOLD, LAND or silence, from each state of the memory and in time."""
    lasting = {
        "plan none": (Told(plan="none"), C.bad_land),
        "loss": (Told(packet_loss=0.5), C.lost_hold),
        "failure": (Told(failure="see: x"), 0.0),
        "no telemetry": (Told(own=None, age=math.inf), 0.0),
        "wrong": (Told(plausible=False), 0.0),
        "blind": (Told(blind=5.1), 0.0),
        "grave": (Told(broken=GIVE_BACK), 0.0),
        "outside": (Told(outside=(1.1, 0.0)), 0.0),
    }
    for state, (name, (told, within)) in itertools.product(found.states.values(), lasting.items()):
        machine = copy.copy(state)
        ticks = [machine.tick(told).request for _ in range(1 + math.ceil(within / DT))]
        assert ticks[-1] is not NONE, name


def test_each_reachable_state_judges_by_the_table_and_bounds_its_command(capsys):
    found = reachable()
    ends_in_a_request(found)
    verdicts = found.transitions + in_short(found)
    assert len(found.states) > 50
    assert verdicts > 40_000
    with capsys.disabled():
        print(f"\nguard: {len(found.states)} states, {verdicts} verdicts")


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_same_with_every_combination(capsys):
    found = reachable()
    owns = (SLOW, FAST, WRONG["turned over"], WRONG["huge"])
    told = combinations(PLANS, owns, OUTSIDE, BLIND, GAPS, BROKEN)
    told += untold(PLANS, (0.1, 0.4), (0.0, 0.5), ("", "see: x"))
    some = {(*s.key()[:1], s.key()[2], s.key()[3] is None): s for s in found.states.values()}
    verdicts = check(replace(found, states=some), told)
    assert verdicts > 1_000_000
    with capsys.disabled():
        print(f"\nguard: {len(found.states)} states, {verdicts} verdicts")


def _without(name):
    def patch(monkeypatch):
        monkeypatch.setattr(Guard, name, lambda *a: None)

    return patch


RULES = {
    "1": lambda p: p.setattr(Guard, "_known", lambda self, s: s.own),
    "2": lambda p: p.setattr(
        Guard,
        "_implausible",
        lambda self, own: self._verdict(module.level(own, C), Reason.PLAN),
    ),
    "4": _without("_late"),
    "5": lambda p: p.setattr(module, "_usable", lambda plan: plan),
    "6": _without("_outside_fence"),
    "7": _without("_gravely_broken"),
    "8": _without("_blind"),
    "9": _without("_broken"),
    "10": lambda p: p.setattr(
        Guard, "_bounded", lambda self, u: module.RateCommand(u[1:4], float(u[0]))
    ),
    "the count": lambda p: p.setattr(Guard, "_count", lambda *a, **k: None),
    "finite": lambda p: p.setattr(module, "_state_finite", lambda own: True),
}


@pytest.mark.parametrize("rule", RULES)
def test_the_search_fails_without_rule(rule, monkeypatch):
    RULES[rule](monkeypatch)
    with pytest.raises(AssertionError):
        in_short(reachable())
