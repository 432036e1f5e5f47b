"""The phase machine, checked in every state that it can reach.

Inputs are quantised: each mode, armed or not, ready or not, and so on, and a tick 0.1 to 1 s after
the last. Times are kept relative to now and only as far as the machine looks at them, so that the
states are finitely many.
"""

import copy
import itertools

import numpy as np
import pytest

from companion.guidance.mission import MissionConfig
from companion.supervision import phases as module
from companion.supervision.phases import GiveBack, PhaseMachine
from companion.types import Phase
from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.autopilots.betaflight import Betaflight
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.wire.messages import Heartbeat, VehicleState
from tests.companion.supervision.exploring import explore

ADAPTERS = {"px4": Px4(1), "ardupilot": ArduPilot(1), "betaflight": Betaflight(1)}
OTHER = 12345  # a pilot's mode that is none of ours
FLYING = (Phase.ENGAGE, Phase.FLY, Phase.LAND)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
AT = {
    height: VehicleState(0.0, np.array([0.0, 0.0, height]), np.zeros(3), LEVEL, np.zeros(3))
    for height in (0.0, 3.0)
}


class Told:
    """One tick's inputs, as names."""

    def __init__(self, dt, mode, armed, ready, complete, known, height, release, *, own=True):
        self.dt, self.mode, self.armed, self.ready = dt, mode, armed, ready
        self.complete, self.known, self.height = complete, known, height
        self.release, self.own = release, own

    def __repr__(self):
        return str(vars(self))


class Checked:
    """A phase machine with its clock; each tick asserts what has to hold of every tick."""

    def __init__(self, adapter, auto, land):
        self.machine = PhaseMachine(MissionConfig(auto=auto, land=land), adapter)
        self.adapter, self.auto, self.now = adapter, auto, 0.0
        self.resumed = False  # from then on it is as without `auto`
        self.arms = {adapter.arm()[-1]}  # of several messages the last one arms
        self.climbs, self.engages = {adapter.takeoff(2.0)[-1]}, set(adapter.offboard())

    def __copy__(self):
        other = object.__new__(Checked)
        other.__dict__.update(self.__dict__)
        other.machine = copy.copy(self.machine)
        return other

    def key(self):
        """What the machine's future depends on, with ages only as far as they matter."""
        m = self.machine
        repeat = module._TAKEOFF_SHOWS if m.phase is Phase.TAKEOFF else module._REPEAT
        due = min(round(self.now - m._requested_at, 1), repeat)
        answer = min(round(self.now - m._arm_requested_at, 1), module._ARM_ANSWER + 0.1)
        streamed = min(round(self.now - m._engaged_at, 1), 0.3)
        return (
            m.phase, due, answer, streamed, m._ground, m._releasing, m._giving, m._given,
            m._heard, m._found_in_offboard, m._armed_by_pilot, m._takeoff_seen, self.resumed,
        )  # fmt: skip

    def tick(self, told):
        """Tick, and return the decision."""
        m, a = self.machine, self.adapter
        self.now += told.dt
        before = m.phase
        if told.release == "reboot":
            m.rebooted()
        elif told.release == "resume":
            self.resumed |= before in (Phase.PASSIVE, Phase.DONE)
            m.resume()
        elif told.release is not None:
            m.release(told.release)
        heartbeat = None
        if told.mode is not None:
            heartbeat = Heartbeat(a.autopilot, 2, told.armed, a.modes.get(told.mode, OTHER), 4)
        own = AT[told.height] if told.own else None
        decision = m.update(
            self.now,
            heartbeat,
            own,
            told.ready,
            told.complete,
            told.known,
            airborne=told.height > 0.0,
        )
        self.check(told, before, decision)
        return decision

    def check(self, told, before, d):
        """Assert what holds of every tick, whatever came before."""
        asked = set(d.requests)
        assert d.phase is self.machine.phase
        if d.phase in (Phase.PASSIVE, Phase.DONE):
            assert not d.stream, told  # never a stream in passive
        if told.release == "reboot":
            assert before is Phase.WAIT or d.phase is Phase.PASSIVE, told
        if self.resumed:
            assert not asked & (self.arms | self.climbs | self.engages), told
        if before in (Phase.PASSIVE, Phase.DONE) and told.release == "resume":
            assert d.phase in (before, Phase.WAIT, Phase.ENGAGE), told
            assert d.phase is not Phase.ENGAGE or told.armed, told
        elif before in (Phase.PASSIVE, Phase.DONE):
            assert d.phase in (before, Phase.PASSIVE), told  # control is never taken again
            assert not asked, told
        if d.stream:
            assert d.phase in FLYING, told
            assert told.armed, told  # setpoints go to a vehicle that flies, or is about to
            assert told.mode is not None, told
            assert told.own, told
        if d.stream and d.phase is not Phase.ENGAGE:
            assert told.mode == "offboard", told  # a pilot's mode ends the stream in that tick
        if asked & self.arms:
            assert self.auto, told  # never armed by itself without `auto`
            assert told.ready, told
            assert not told.armed, told
            assert not self.machine._armed_by_pilot, told  # nor one that a pilot has flown
        if d.phase in (Phase.ARM, Phase.TAKEOFF) or asked & self.climbs:
            assert self.auto, told
        if asked & self.engages:
            assert self.auto, told  # the pilot changes to offboard
        if before is Phase.WAIT and d.phase is Phase.ENGAGE:
            assert told.ready, told
            assert told.known, told
        if before in FLYING[:2] and told.mode is not None and told.own and not told.armed:
            assert d.phase is Phase.PASSIVE, told  # a kill switch


# (ready, complete, known): each alone, beside what else lets a flight go on
FEW = [(True, False, True), (False, False, True), (True, False, False), (True, True, True)]
EVERY = list(itertools.product((False, True), repeat=3))


def alphabet(modes, gaps, releases, flags):
    """Every combination; and the ticks without a heartbeat, or without an own state."""
    every = [
        Told(gap, mode, armed, *told, height, release)
        for gap, mode, armed, told, height, release in itertools.product(
            gaps, modes, (False, True), flags, (0.0, 3.0), releases
        )
    ]
    every += [
        Told(gap, mode, armed, False, False, True, 0.0, release, own=False)
        for gap, mode, armed, release in itertools.product(gaps, modes, (False, True), releases)
    ]
    every += [Told(gap, None, False, True, True, True, 0.0, r) for gap in gaps for r in releases]
    return every


def a_way_out(state, adapter):
    """Assert that from this state control can be given back, at once and for good.

    The vehicle obeys no request for a second: they are repeated, and setpoints go on, so that its
    failsafe does not decide. Then it obeys, or a pilot takes it: nothing is sent any more.
    """
    for how in (GiveBack.HOLD, GiveBack.LAND):
        machine = copy.copy(state)
        was = machine.machine.phase
        told = Told(0.1, "offboard", True, True, False, True, 3.0, how)
        ticks = [machine.tick(told) for _ in range(11)]
        if was in FLYING:
            ways = {m for d in ticks for m in d.requests}
            landing = was is Phase.LAND or machine.machine._giving is GiveBack.LAND
            returning = machine.machine._giving is GiveBack.RETURN
            wanted = (returning and adapter.rtl()) or adapter.hold()
            assert set(adapter.land() if landing else wanted) <= ways, was
            asked = [k for k, d in enumerate(ticks) if d.requests]
            assert asked[0] <= 3, (was, asked)
            assert max(b - a for a, b in itertools.pairwise([*asked, 11])) <= 4, (was, asked)
            assert all(d.stream for d in ticks), was
        else:
            assert not any(d.stream or d.requests for d in ticks), was
        for mode in ("hold", "land", "other"):  # whichever it then shows
            after = copy.copy(machine)
            ended = after.tick(Told(0.1, mode, True, True, False, True, 3.0, None))
            assert ended.phase in (Phase.PASSIVE, Phase.DONE)
            assert (ended.stream, ended.requests) == (False, []), (was, mode)


def checked(name, auto, land, gaps, releases, modes, flags):
    """Explore one autopilot and mission; return what was found."""
    adapter = ADAPTERS[name]
    modes = [m for m in modes if m in adapter.modes or m == "other"]
    start = Checked(adapter, auto, land)
    told = alphabet(modes, gaps, releases, flags)
    found = explore(start, Checked.key, told, Checked.tick)
    for state in found.states.values():
        a_way_out(state, adapter)
    return found


def coarse(name, auto, land=True):
    """A search that takes seconds: half a second a tick."""
    modes = ("hold", "takeoff", "offboard", "land", "other")
    releases = (None, GiveBack.HOLD, GiveBack.LAND, "reboot", "resume")
    return checked(name, auto, land, (0.5,), releases, modes, FEW)


# The others are searched by the slow test.
QUICK = [("px4", False), ("px4", True), ("ardupilot", True), ("betaflight", False)]


@pytest.mark.parametrize(("name", "auto"), QUICK)
def test_every_state_has_a_way_out_and_no_step_does_what_must_not_be(name, auto, capsys):
    found = coarse(name, auto)
    reached = {state.machine.phase for state in found.states.values()}
    wanted = set(Phase) if auto else set(Phase) - {Phase.ARM, Phase.TAKEOFF}
    assert reached == wanted
    with capsys.disabled():
        print(f"\n{name}, auto {auto}: {len(found.states)} states, {found.transitions} transitions")


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("land", [False, True])
@pytest.mark.parametrize("auto", [False, True])
@pytest.mark.parametrize("name", ADAPTERS)
def test_the_same_with_ticks_of_each_length_and_every_way_back(name, auto, land, capsys):
    modes = ("hold", "takeoff", "offboard", "land", "rtl", "other")
    releases = (None, *GiveBack, "reboot", "resume")
    found = checked(name, auto, land, (0.1, 1.0), releases, modes, EVERY)
    assert found.transitions > 100_000
    with capsys.disabled():
        print(f"\n{name}, auto {auto}, land {land}: {len(found.states)} states, "
              f"{found.transitions} transitions")  # fmt: skip


def _stubborn(patch):
    patch.setattr(PhaseMachine, "_taken_over", lambda *a: False)


def _arms_itself(patch):
    patch.setattr(PhaseMachine, "_auto", True)


def _never_releases(patch):
    patch.setattr(PhaseMachine, "_release", lambda self, *a: module.Decision(self.phase))


def _asks_once(patch):
    patch.setattr(module, "_REPEAT_RELEASE", 1e9)


def _deaf_to_the_kill_switch(patch):
    advance = PhaseMachine._advance
    patch.setattr(
        PhaseMachine, "_advance", lambda self, mode, armed, *a: advance(self, mode, True, *a)
    )


def _takes_what_it_found(patch):
    patch.setattr(PhaseMachine, "rebooted", lambda self: setattr(self, "phase", Phase.WAIT))


def _streams_in_passive(patch):
    update = PhaseMachine.update

    def stream(self, *args, **more):
        d = update(self, *args, **more)
        return module.Decision(d.phase, d.requests, d.stream or d.phase is Phase.PASSIVE)

    patch.setattr(PhaseMachine, "update", stream)


def _takes_over_with_any_thrust(patch):
    take = PhaseMachine._take_over
    patch.setattr(PhaseMachine, "_take_over", lambda self, known: take(self, True))


@pytest.mark.parametrize(
    "rule",
    [
        _stubborn,
        _arms_itself,
        _never_releases,
        _asks_once,
        _deaf_to_the_kill_switch,
        _takes_what_it_found,
        _streams_in_passive,
        _takes_over_with_any_thrust,
    ],
)
def test_the_search_fails_without_a_rule(rule, monkeypatch):
    rule(monkeypatch)
    with pytest.raises(AssertionError):
        coarse("px4", auto=False)
