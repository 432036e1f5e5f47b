"""Rows of the fault matrix about the daemon and the link, as in `checks`."""

from dataclasses import replace

import numpy as np

from companion.supervision.guard import Reason
from companion.supervision.phases import Phase
from mavlink_bridge.wire.messages import Command, CommandId, LocalPosition
from tests.closed_loop.matrix.inprocess import AUTOPILOT, Companion, fly
from tests.closed_loop.matrix.measures import (
    CRUISE,
    SHORT,
    costs_of_ticks,
    first_with,
    flown_with,
    last_target,
    mode_after,
    modes_from,
)


def row_1(note):
    def kill(f):
        f.companions[0].connected = False

    def restart(f):
        f.companions.append(Companion(f.companions[0].settings, f.companions[0].endpoint))
        f._drones[0].frames = f.companions[1]

    f = fly(
        at={CRUISE + 0.01: kill, CRUISE + 2.01: restart},
        world={},
        drones__parameters=AUTOPILOT | {"COM_OF_LOSS_T": 0.5, "COM_OBL_RC_ACT": 4.0},
        mission__time_limit=24.0,
    )
    land = mode_after(f, CRUISE + 0.05, "LAND")
    assert land <= 0.6
    again = f.companions[1]
    assert len(again.outs) > 50
    asked_for = {m.command for o in again.outs for m in o.messages if isinstance(m, Command)}
    assert asked_for <= {CommandId.SET_MESSAGE_INTERVAL}  # neither arming nor offboard
    truth = f.truth.arrays()
    down = truth["t"][truth["armed"][:, 0].astype(bool)][-1]  # then PX4 shows its last mode again
    assert "OFFBOARD" not in [m for t, m in f.modes[0] if CRUISE + 1.0 < t <= down]
    assert truth["position"][-1, 0, 2] < 0.3
    assert not truth["armed"][-1, 0]
    f.check_always()
    note("LAND", land)


def row_9(note):
    for kind, amount in (
        ("link_loss", 0.05),
        ("link_loss", 0.2),
        ("link_duplicate", 0.3),
        ("link_reorder", 0.3),
        ("link_flip", 0.2),
    ):
        f = fly([{"kind": kind, "amount": amount}], mission__time_limit=24.0)
        assert f.figures()["targets_reached"]["drone1"] == "1/1", (kind, amount)
        assert f.figures()["obstacle_collisions"] == 0
        f.check_always()
        note(f"at its target [s], {kind.removeprefix('link_')} {amount:.0%}", last_target(f))
    f = fly([{"kind": "link_loss", "amount": 0.5, "at": CRUISE}], count=2, mission__time_limit=24.0)
    assert f.figures()["obstacle_collisions"] == f.figures()["agent_collisions"] == 0
    f.check_always()
    assert f.most_tilt(CRUISE) < 45.0
    for c in f.companions:  # that commands get lost is noticed, and said until the vehicle holds
        noticed = first_with(c, CRUISE, Reason.LOSSY)
        assert all(
            o.verdict is None or o.verdict.reason is not Reason.PLAN for _, o in c.ticks(noticed)
        ), noticed
        assert noticed < CRUISE + 1.5
    note("most tilt at 50 % [°]", max(f.most_tilt(CRUISE, i) for i in range(2)))
    note("HOLD at 50 %", mode_after(f, CRUISE, "HOLD"))


def row_10(note):
    noisy = [
        {"kind": "link_garbage", "amount": 1e6, "at": 6.0},
        {"kind": "link_foreign", "amount": 200.0, "at": 6.0},
    ]
    costs, slowest = [], []
    for ticks, f in costs_of_ticks(6.5, [], noisy, **SHORT):
        assert f.speed(10.0) > 1.2
        f.check_always()
        c = f.companions[0]
        costs.append(float(np.median(ticks)))
        slowest.append(float(np.percentile(ticks, 99)))
    assert slowest[1] < slowest[0] + 0.1 * c.config.timing.period, slowest
    assert c.link.codec.statistics.bad_bytes > 1_000_000
    assert c.link.codec.statistics.foreign > 100
    note("garbage costs, s of the 0.1 (median, processor time)", costs[1] - costs[0])
    note("the same, p99", slowest[1] - slowest[0])


def row_25(note):
    """The line is gone for three seconds and comes back: the vehicle holds, and goes on holding."""
    f = fly(
        [{"kind": "link_loss", "amount": 1.0, "at": CRUISE, "for": 3.0}],
        **(SHORT | {"mission__time_limit": 16.0}),
    )
    assert "OFFBOARD" not in modes_from(f, CRUISE + 1.2)
    c = f.companions[0]
    assert c.outs[-1].phase is Phase.PASSIVE
    heard = next(o.time for o in c.outs if o.time > CRUISE + 1.0 and o.phase is Phase.PASSIVE)
    assert not [t for t, _ in c.setpoints() if t > heard]
    f.check_always()
    assert heard <= CRUISE + 3.0 + 2.0
    note("passive after the line is back", heard - CRUISE - 3.0)


def row_31(note):
    """Stamps that cannot be true are refused, and then there is no telemetry; others are flown."""
    for ahead in (0.05, 0.12, 3600.0):
        f = fly([{"kind": "stamps", "amount": ahead, "at": CRUISE}], **SHORT)
        c = f.companions[0]
        assert Reason.PLAN not in c.reasons(f.drone_time(CRUISE + 0.75))
        assert "LAND" not in modes_from(f, CRUISE)
        assert f.speed(10.5) < 0.3
        f.check_always()
        note(f"HOLD, stamps {ahead:g} s ahead", mode_after(f, CRUISE, "HOLD"))
    f = fly([{"kind": "stamps", "amount": -3600.0, "at": CRUISE}], **SHORT)
    f.check_always()  # as after a restart of the autopilot
    last = f.companions[0].streamed(CRUISE)[-1]
    assert last < CRUISE + 0.3
    note("no setpoint, stamps 1 h behind", last - CRUISE)
    for late in (0.02, -0.05):
        f = fly([{"kind": "stamps", "amount": late, "at": CRUISE}], **SHORT)
        assert Reason.NO_STATE not in f.companions[0].reasons(0.0)
        assert f.speed(10.0) > 1.2
        f.check_always()


def row_31_one_stream(note):
    """Positions alone are 0.12 s ahead: they are refused, and the drone lands without them."""

    def ahead(inputs):
        wrong = [
            replace(r, message=replace(r.message, time=r.message.time + 0.12))
            if isinstance(r.message, LocalPosition) and inputs.time > noticed[0]
            else r
            for r in inputs.received
        ]
        return replace(inputs, received=wrong)

    noticed = [np.inf]
    f = flown_with(lambda f: noticed.__setitem__(0, f.drone_time(CRUISE)), before=ahead, **SHORT)
    assert Reason.PLAN not in f.companions[0].reasons(f.drone_time(CRUISE + 0.8))
    f.check_always()
    note("LAND, positions ahead", mode_after(f, CRUISE, "LAND"))
