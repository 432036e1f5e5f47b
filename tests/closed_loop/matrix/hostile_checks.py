"""Rows of the fault matrix about hostile lines and failing software, as in `checks`."""

from dataclasses import replace

import numpy as np

from companion.supervision.guard import Reason
from companion.types import Phase
from tests.closed_loop.matrix.measures import CRUISE, SHORT, costs_of_ticks, flown_with, mode_after

SIGNED = SHORT | {"drones__signing": True}


def listening(f, i=0):
    """Count the companion's own frames that it hears."""
    c = f.companions[i]
    c.echoes, own = 0, c.config.link.component_id

    def look(inputs):
        c.echoes += sum(r.source.component == own for r in inputs.received)
        return inputs

    c.before = look


def row_26(note):
    """On a signed line all that was sent is played back, in both directions."""
    hostile = [
        {"kind": "link_replay", "amount": 200.0, "at": 3.0},
        {"kind": "link_reflect", "amount": 1.0, "at": 3.0},
        {"kind": "link_spoof", "amount": 50.0, "at": 3.0},
    ]
    f = flown_with(listening, hostile, **SIGNED)
    c = f.companions[0]
    counts = c.link.codec.statistics
    vehicle = f._drones[0].companion.codec.statistics
    assert counts.replayed > 1000
    assert vehicle.replayed > 500  # its own frames among them are of no such sender
    assert counts.unsigned > 100
    assert c.echoes == 0
    assert "HOLD" not in [name for t, name in f.modes[0] if t > 5.0]
    assert f.speed(10.0) > 1.2
    f.check_always()
    note("played back and heard", float(c.echoes))


def row_27(note):
    """10 MB/s on the vehicle's own line: each tick's cost, by processor time.

    Then, on a signed line, 4 MB/s of bytes that look like the vehicle's frames: cut, mutated.
    """
    costs = []
    cut = flown_with(listening, [{"kind": "link_garbage", "amount": 4e6, "at": 6.0}], **SIGNED)
    assert cut.companions[0].link.codec.statistics.replayed > 1000
    assert {o.verdict.reason for _, o in cut.companions[0].ticks(6.5, 10.0)} == {Reason.PLAN}
    assert cut.companions[0].echoes == 0
    cut.check_always()
    flood = {"kind": "link_flood", "amount": 1e7, "at": 6.0}
    for ticks, f in costs_of_ticks(6.5, [], [flood], **SHORT):
        c = f.companions[0]
        assert f.speed(10.0) > 1.2
        f.check_always()
        costs.append(float(np.percentile(ticks, 99)))
    assert c.link.codec.statistics.bad_bytes > 10_000_000
    assert {o.verdict.reason for _, o in c.ticks(6.5, 10.0)} == {Reason.PLAN}
    assert costs[1] < costs[0] + 0.1 * c.config.timing.period, costs
    note("p99 of the tick [s], calm", costs[0])
    note("p99 of the tick [s], 10 MB/s", costs[1])


def spoil_detector(f, kind, since, until=np.inf, i=0):
    """Let drone i's detector fail in [since, until) s: give "nan", "inf", "huge", or "raises"."""
    frontend = f.companions[i].companion._perception
    detect = frontend._detect

    def wrong(frame, *given):
        if not since <= f._now / 1e3 < until:
            return detect(frame, *given)
        if kind == "raises":
            raise ValueError("cannot convert float NaN to integer")
        number = {"nan": np.nan, "inf": np.inf, "huge": 1e30}[kind]
        rows = np.full((2, 6), number)
        return detect(replace(frame, arrays=frame.arrays | {"neighbours": rows}), *given)

    frontend._detect = wrong


def row_28(note):
    """The detector gives NaN, infinite or huge numbers, or raises: as a camera that is blind."""
    for kind in ("nan", "inf", "huge", "raises"):
        f = flown_with(
            lambda f, kind=kind: spoil_detector(f, kind, CRUISE),
            **(SHORT | {"mission__time_limit": 18.0}),
        )
        c = f.companions[0]
        first = [o for _, o in c.ticks(CRUISE + 0.15)]
        assert all(o.verdict is None or o.verdict.reason is Reason.BLIND for o in first), kind
        assert f.speed(CRUISE + 1.0) <= 0.5
        hold = mode_after(f, CRUISE, "HOLD")
        assert hold <= 5.5
        f.check_always()
        note(f"HOLD, {kind}", hold)


STAGES = {
    "vehicle": ("_vehicle", "update"),
    "see": ("_perception", "see"),
    "map": ("_obstacles", "update"),
    "track": ("_neighbours", "update"),
    "motion": ("_motion", "update"),
    "guide": ("_guidance", "decide"),
    "plan": ("_planning", "plan"),
    "supervise": ("_supervision", "decide"),
    "guard": ("_supervision._guard", "judge"),
    "command": ("_actuation", "setpoint"),
    "serve": ("_services", "update"),
    "height": ("_vehicle", "see_ground"),
    "velocity": ("_vehicle", "see_flow"),
    "watch": ("_monitors", "update"),
    "look round": ("_surroundings", "update"),
    "ask": ("_vehicle", "ask"),
}


def raises(f, stage, since, i=0):
    """Let this stage of drone i raise from `since` [s] on."""
    path, name = STAGES[stage]
    part = f.companions[i].companion
    for step in path.split("."):
        part = getattr(part, step)
    true = getattr(part, name)

    def wrong(*args, **more):
        if f._now / 1e3 >= since:
            raise ZeroDivisionError("by zero")
        return true(*args, **more)

    setattr(part, name, wrong)


def row_29(note):
    """Each stage raises in turn, from some tick on: HOLD, by the guard or without it."""
    for stage in STAGES:
        f = flown_with(lambda f, stage=stage: raises(f, stage, CRUISE), **SHORT)
        c = f.companions[0]
        hold = mode_after(f, CRUISE, "HOLD")
        assert hold <= 0.25, (stage, hold)  # a tick, its delay, and the autopilot's answer
        assert "OFFBOARD" not in [m for t, m in f.modes[0] if t > CRUISE + hold]
        # Without heartbeats the companion cannot see that the vehicle holds; it falls silent.
        assert c.outs[-1].phase is Phase.PASSIVE or stage == "vehicle", stage
        assert not c.streamed(CRUISE + 1.5), stage
        assert "ZeroDivisionError: by zero" in c.outs[-1].failure
        f.check_always()
        note(f"HOLD, {stage}", hold)


def row_30(note):
    """A forger uses the vehicle's ids, and commands the vehicle as if it were the companion."""
    forger = [
        {"kind": "link_spoof", "amount": 1000.0, "at": 3.0},
        {"kind": "link_forge", "amount": 50.0, "at": 3.0},
    ]
    f = flown_with(listening, forger, **SIGNED)
    ours, theirs = f.companions[0].link.codec.statistics, f._drones[0].companion.codec.statistics
    assert ours.unsigned > 5000
    assert theirs.unsigned > 200
    heard = max(ours.received - theirs.sent, 0) + max(theirs.received - ours.sent, 0)
    assert heard == 0, (ours, theirs)
    assert f.truth.arrays()["armed"][-1].all()
    assert f.speed(10.0) > 1.2
    f.check_always()
    note("forged and heard", heard)
