"""Checks of the fault matrix: one function for each row.

Each reports its measurements by `note(what, seconds)` and raises AssertionError where the row does
not hold. Times are of the flight; drones fly from 5 s on, at full speed from 7 s.
"""

import numpy as np

from companion.perception.camera_health import CameraFault
from companion.supervision.guard import AutopilotRequest, Reason
from companion.types import Phase
from mavlink_bridge.wire.messages import Heartbeat
from tests.closed_loop.matrix import (
    attack_checks,
    camera_checks,
    hostile_checks,
    link_checks,
    more_checks,
    power_checks,
    thrust_checks,
    world_checks,
)
from tests.closed_loop.matrix.inprocess import fly
from tests.closed_loop.matrix.measures import (
    CRUISE,
    SHORT,
    asked,
    first_with,
    flown_with,
    last_target,
    mode_after,
    nan_between,
    seconds_until,
    spoil_solves,
)
from tests.closed_loop.matrix.strikes import move_fence

OFFBOARD = 0x00060000  # PX4's custom_mode


# --- rows ----------------------------------------------------------------------------------


def row_3(note):
    f = flown_with(lambda f: spoil_solves(f, CRUISE, [0]), **SHORT)
    reasons = f.companions[0].reasons(CRUISE, CRUISE + 0.35)
    assert reasons == [Reason.SHIFTED_PLAN, Reason.PLAN, Reason.PLAN, Reason.PLAN]
    assert f.companions[0].at(CRUISE).verdict.bad_ticks == 1
    f.check_always()
    shifted = first_with(f.companions[0], CRUISE, Reason.SHIFTED_PLAN)
    note("shifted plan", shifted - CRUISE)


def row_4(note):
    f = flown_with(lambda f: spoil_solves(f, CRUISE, range(12)), **SHORT)
    reasons = f.companions[0].reasons(CRUISE, CRUISE + 1.1)
    assert reasons == [Reason.SHIFTED_PLAN] * 2 + [Reason.BRAKE] * 9
    slow = seconds_until(f, CRUISE, lambda v, p: np.linalg.norm(v) < 0.3)
    assert slow < 1.2
    assert f.companions[0].at(CRUISE + 1.2).verdict.reason is Reason.PLAN  # and goes on
    f.check_always()
    note("brakes", first_with(f.companions[0], CRUISE, Reason.BRAKE) - CRUISE)
    note("slower than 0.3 m/s", slow)


def row_5(note):
    f = fly(
        at={0.0: lambda f: spoil_solves(f, CRUISE, range(999))},
        **(SHORT | {"mission__time_limit": 15.0}),
    )
    land = mode_after(f, CRUISE, "LAND")
    assert land <= 2.2
    assert f.companions[0].outs[-1].phase is Phase.PASSIVE
    assert np.linalg.norm(f.truth.arrays()["velocity"][-1, 0, :2]) < 0.5
    f.check_always()
    note("LAND", land)


def row_6(note):
    def spoil(f):
        spoil_solves(f, CRUISE, [0], u=lambda u: u * np.nan)

    faults = [{"kind": "telemetry_nan", "at": 6.0, "amount": 0.5}]
    f = fly(faults, at={0.0: spoil}, before=nan_between(7.0, 9.0), count=2, **SHORT)
    c = f.companions[0]
    assert {o.failure for o in c.outs} == {""}  # refused before a stage makes anything of it
    assert c.at(CRUISE).verdict.reason is Reason.BRAKE  # a plan of NaN is no plan, shifted or not
    assert {o.verdict.request for o in c.outs if o.verdict} == {AutopilotRequest.NONE}
    assert c.companion._vehicle._own.counters.not_finite > 50
    assert all(np.isfinite(t.P).all() and np.isfinite(t.p).all() for o in c.outs for t in o.tracks)
    assert f.speed(CRUISE + 1.5) > 1.0  # the rest of telemetry flies it
    f.check_always()
    states = [x for o in c.outs if o.own for x in (o.own.p, o.own.v, o.own.q_wb, o.own.omega)]
    note("states with NaN", sum(not np.isfinite(x).all() for x in states))


def row_7(note):
    f = fly([{"kind": "telemetry_stale", "at": CRUISE}], **SHORT)
    c = f.companions[0]
    last = c.companion._vehicle._own._positions[-1].time
    assert c.at(last + 0.2).verdict.reason is Reason.PLAN  # by the model, as if nothing were
    true = f.truth.arrays()
    k = int(np.searchsorted(true["t"], CRUISE + 0.2))
    assert np.linalg.norm(c.at(CRUISE + 0.2).own.v - true["velocity"][k, 0]) < 0.25
    stopped = next(o for o in c.outs if o.verdict and o.verdict.reason is Reason.NO_STATE)
    assert stopped.time - last <= 0.4 + 1e-6
    assert (stopped.verdict.command.omega == 0).all()
    hold = mode_after(f, CRUISE, "HOLD")
    assert hold <= 0.45
    f.check_always()
    note("HOLD", hold)


def row_7_silence(note):
    """Not even a heartbeat: LAND is asked for, then the stream ends and its failsafe has it."""
    f = fly(
        [{"kind": "link_loss", "at": CRUISE, "amount": 1.0}],
        **(SHORT | {"mission__time_limit": 16.0}),
    )
    c = f.companions[0]
    land, end = asked(f, AutopilotRequest.LAND) - CRUISE, c.setpoints()[-1][0] - CRUISE
    assert 1.0 <= land <= 1.15
    assert 1.9 <= end <= 2.1
    assert f.mode() in ("HOLD", "LAND")  # PX4 by itself
    f.check_always()
    note("LAND asked for", land)
    note("silent", end)


def row_8(note):
    for kind, amount in (("position_jump", 3.0), ("position_lost", None), ("quaternion", 0.5)):
        fault = {"kind": kind, "at": CRUISE + 0.01} | ({"amount": amount} if amount else {})
        f = fly([fault], **SHORT)
        land = mode_after(f, fault["at"], "LAND")
        assert land <= 0.4, kind  # a tick and its way to the vehicle after 300 ms
        after = f.companions[0].reasons(CRUISE + 0.4)
        assert not set(after) & {Reason.PLAN, Reason.SHIFTED_PLAN}
        truth = f.truth.arrays()
        up = truth["attitude"][-1, 0]
        assert 1 - 2 * (up[1] ** 2 + up[2] ** 2) > np.cos(np.radians(15)), kind  # level
        f.check_always()
        note(f"LAND, {kind}", land)


def row_8_on_ground(note):
    f = fly([{"kind": "quaternion", "amount": 0.5}], **(SHORT | {"mission__time_limit": 5.0}))
    assert {o.phase for o in f.companions[0].outs} == {Phase.WAIT}
    assert not f.companions[0].setpoints()
    note("setpoints on the ground", len(f.companions[0].setpoints()))


def row_13(note):
    for fault in ({"kind": "mode", "to": "position"}, {"kind": "kill"}):
        shown = []
        f = fly([fault | {"at": CRUISE}], before=lambda i, s=shown: _first_change(i, s), **SHORT)
        c = f.companions[0]
        last = c.setpoints()[-1][0]
        assert last <= shown[0] + 1e-6, fault  # none after the tick whose heartbeat showed it
        assert c.outs[-1].phase is Phase.PASSIVE
        assert not any(
            type(m).__name__ == "Command" for o in c.outs if o.time > shown[0] for m in o.messages
        )
        note(f"after {fault['kind']} (HEARTBEAT: 1 Hz)", last - CRUISE)


def _first_change(inputs, shown):
    """Note the tick with the first heartbeat after CRUISE that is not armed in offboard."""
    for r in inputs.received:
        m = r.message
        changed = isinstance(m, Heartbeat) and (not m.armed or m.custom_mode != OFFBOARD)
        if changed and inputs.time > CRUISE and not shown:
            shown.append(inputs.time)
    return inputs


def row_14(note):
    f = fly([{"kind": "reboot", "at": CRUISE}], **(SHORT | {"mission__time_limit": 13.0}))
    c = f.companions[0]
    assert c.companion._vehicle._own.counters.reboots == 1
    assert c.outs[-1].phase is Phase.PASSIVE
    assert c.outs[-1].own is not None  # of the new life
    assert abs(c.outs[-1].own.time - (13.0 - CRUISE)) < 0.3
    times = [o.time for o in c.outs]
    back = next(n for n in range(1, len(times)) if times[n] < times[n - 1])
    assert all(o.verdict is None for o in c.outs[back + 1 :])
    last = max(c.streamed(CRUISE), default=CRUISE) - CRUISE
    assert last <= 0.2
    note("no setpoint after", last)


def row_15(note):
    kinds = {"camera_dead": CameraFault.DEAD, "camera_frozen": CameraFault.FROZEN,
             "camera_black": CameraFault.BLACK, "camera_saturated": CameraFault.SATURATED,
             "camera_late": CameraFault.LATE}  # fmt: skip
    for kind, trouble in kinds.items():
        f = fly(
            [{"kind": kind, "at": CRUISE + 0.01}],
            pictures=True,
            count=2,
            drones__spacing=3.0,
            **SHORT,
        )
        c = f.companions[0]
        noticed = next(o.time for o in c.outs if o.time > CRUISE and o.fault is trouble)
        assert noticed - CRUISE <= (0.2 if kind == "camera_late" else 0.1) + 1e-6, kind
        # A picture that is late shows it when it is due, not before.
        since = noticed if kind == "camera_late" else CRUISE + 0.01
        slow = seconds_until(f, since, lambda v, p: np.linalg.norm(v) <= 0.5)
        assert slow <= 0.5, (kind, slow)
        after = f.truth.arrays()
        rest = np.linalg.norm(after["velocity"][after["t"] >= CRUISE + 2.0, 0], axis=1)
        assert rest.max() < 0.25, (kind, rest.max())
        if kind != "camera_late":
            coasting = [t for o in c.outs if o.time > CRUISE for t in o.tracks]
            spread = [np.trace(t.P[:3, :3]) for t in coasting]
            assert spread == sorted(spread), kind
        f.check_always()
        note(f"≤ 0.5 m/s, {kind}", slow)


def row_16(note):
    faults = [
        {"kind": "missed", "amount": 0.3},
        {"kind": "ghosts", "amount": 0.05},
        {"kind": "swaps", "amount": 0.2},
        {"kind": "range_bias", "amount": 1.2},
    ]
    # Three that squeeze round one target land on one spot, where they touch on the ground: their
    # flight is judged in the air. With a place for each to land on it is judged to its end.
    together = fly(faults, count=3, mission__time_limit=30.0, seed=3).figures()
    f = fly(
        faults,
        count=3,
        mission__time_limit=30.0,
        mission__spread=True,
        mission__targets=[[10.0, 0.0, 2.0], [14.0, 0.0, 2.0]],
        seed=3,
    )
    f.check_always()
    apart = f.figures()
    assert set(together["targets_reached"].values()) == {"1/1"}
    assert set(apart["targets_reached"].values()) == {"2/2"}
    for figures in (together, apart):
        assert figures["obstacle_collisions"] == figures["agent_collisions"] == 0
    note("last drone at its target [s]", last_target(f))


def row_17(note):
    for kind in ("stop", "turn_into", "kill"):
        f = fly(
            [{"kind": kind, "drone": "drone1", "at": CRUISE}],
            count=3,
            world={},
            mission__time_limit=14.0,
        )
        f.check_always(healthy=(1, 2))
        truth = f.truth.arrays()
        flying = truth["t"] > 5.0
        gaps = [
            np.linalg.norm(truth["position"][flying, 0] - truth["position"][flying, k], axis=1)
            for k in (1, 2)
        ]
        assert min(g.min() for g in gaps) > 0.5, (kind, [g.min() for g in gaps])
        assert f.speed(9.5, 0) < 0.3 or kind != "stop"
        assert truth["position"][-1, 0, 2] < 0.3 or kind != "kill"
        assert all(f.moved(k, 9.0) > 1.0 for k in (1, 2)), kind  # the others fly on
        note(f"least distance [m], {kind}", min(float(g.min()) for g in gaps))


def row_18(note):
    plain, apart = fly(**SHORT), 0.0
    for kind, amount in (("clock_jump", 3600.0), ("clock_jump", -3600.0), ("timesync_jump", 0.5)):
        f = fly([{"kind": kind, "amount": amount, "at": 6.0}], **SHORT)
        p, q = f.truth.arrays()["position"], plain.truth.arrays()["position"]
        assert (p == q).all(), kind
        apart = max(apart, float(np.abs(p - q).max()))
        assert f.speed(10.0) > 1.2  # and that is a flight
    note("most that the way differs [m]", apart)


def row_19(note):
    """One pause beside a trunk; then, in the open, each answer late: the next tick is missed, or
    two or four, and what was commanded is held that long. Late for seconds beside a trunk is too
    much: docs/faults.md."""
    f = fly(
        [{"kind": "pause", "amount": 0.2, "at": 7.0, "for": 0.1}], count=2, mission__time_limit=26.0
    )
    assert f.figures()["targets_reached"]["drone1"] == "1/1"
    f.check_always()
    for pause in (0.12, 0.2, 0.4):
        f = fly(
            [{"kind": "pause", "amount": pause, "at": 7.0, "for": 4.0}],
            count=2,
            world={},
            mission__time_limit=26.0,
        )
        assert f.figures()["targets_reached"]["drone1"] == "1/1"
        f.check_always()
        tilt = f.most_tilt(7.0)
        assert tilt < 45.0, (pause, tilt)
        note(f"most tilt [°], {pause:g} s late", tilt)


def row_21(note):
    def fenced(most):  # short of the goal, which a config must not be
        return lambda f: move_fence(f.companions[0].companion, east=[-5.0, most])

    f = fly(at={0.0: fenced(8.0)}, **SHORT)
    p = f.truth.arrays()["position"][:, 0]
    assert p[:, 0].max() < 8.2  # the plan itself stays inside
    assert Reason.FENCE not in f.companions[0].reasons(0.0)
    note("inside by [m]", float(8.0 - p[:, 0].max()))

    # The fence is moved inwards in flight: the drone is outside, all of a sudden.
    for outside, request in ((0.1, AutopilotRequest.NONE), (2.0, AutopilotRequest.LAND)):
        f = fly(
            at={7.51: lambda f, by=outside: fenced(f.vehicles.p[0, 0] - by)(f)},
            world={},
            mission__time_limit=14.0,
        )
        first = next(o.verdict for _, o in f.companions[0].ticks(7.52))
        assert (first.reason, first.request) == (Reason.FENCE, request)
        crossed = f.truth.arrays()
        k = int(np.searchsorted(crossed["t"], 7.5))
        out = crossed["position"][k:, 0, 0].max() - crossed["position"][k, 0, 0]
        assert out < 2.0
        if request is AutopilotRequest.NONE:
            side = crossed["position"][k, 0, 0] - outside
            note("back within", seconds_until(f, 7.5, lambda v, p, side=side: p[0] < side))
        f.check_always()
        note("stops within [m]", float(out))


def row_22(note):
    plain = fly(mission__time_limit=26.0).truth.arrays()
    for fault in (
        {"kind": "battery", "amount": 0.05, "at": 7.0},
        {"kind": "motor", "amount": 0.8, "at": 7.0},
        {"kind": "thrust_scale", "amount": 0.8, "at": 7.0},
        {"kind": "thrust_scale", "amount": 1.2, "at": 7.0},
        {"kind": "gust", "amount": 5.0, "at": 7.0, "for": 3.0},
        {"kind": "gyro_bias", "amount": 0.05},
    ):
        f = fly([fault], mission__time_limit=26.0)
        figures, truth = f.figures(), f.truth.arrays()
        landed = truth["position"][-1, 0, 2] < 0.3
        there = figures["targets_reached"]["drone1"] == "1/1"
        assert there or landed, fault
        assert figures["obstacle_collisions"] == 0, fault
        assert truth["velocity"][:, 0, 2].min() > -1.5, fault  # it does not fall
        assert (truth["position"][-1] != plain["position"][-1]).any(), fault  # and is disturbed
        f.check_always()
        amount = f"{fault['kind']} {fault['amount']:g}"
        note(f"at its target [s], {amount}" if there else f"landed, {amount}",
             last_target(f) if there else None)  # fmt: skip


ROWS = {
    name.removeprefix("row_"): check
    for name, check in [
        *vars(link_checks).items(),
        *vars(hostile_checks).items(),
        *vars(thrust_checks).items(),
        *vars(camera_checks).items(),
        *vars(power_checks).items(),
        *vars(world_checks).items(),
        *vars(attack_checks).items(),
        *vars(more_checks).items(),
        *globals().items(),
    ]
    if name.startswith("row_")
}
