"""Rows from 26 on of the fault matrix in the paper's forest, as `forest_rows`.

Rows 32 and 43 need true pictures, 38 and 42 processes: these are in `checks` and beside the daemon.
"""

from dataclasses import replace

import numpy as np

from companion.perception.camera_health import CameraFault
from companion.supervision.guard import Reason
from companion.types import Phase
from tests.closed_loop.matrix.forest_rows import LATE, Row, one
from tests.closed_loop.matrix.hostile_checks import STAGES, listening, raises, spoil_detector
from tests.closed_loop.matrix.measures import completes, mode_after, modes_from, slow_after
from tests.closed_loop.matrix.strikes import AT

SIGNED = {"drones.signing": True}
END = 29.0  # s, of a flight


def listens(f, i, kind):
    listening(f, i)
    return {}


def unheard(f, i):
    """Nothing of its own is heard, and nobody asks for HOLD."""
    assert f.companions[i].echoes == 0
    assert modes_from(f, AT, i) == {"OFFBOARD"}
    assert f.truth.arrays()["armed"][-1, i]


def check_26(f, i, kind, note):
    counts = f.companions[i].link.codec.statistics
    assert counts.replayed > 1000
    assert counts.unsigned > 100
    unheard(f, i)
    completes(f, i, kind, note)


def check_27(f, i, kind, note):
    assert f.companions[i].link.codec.statistics.bad_bytes > 10_000_000
    unheard(f, i)
    completes(f, i, kind, note)


def check_30(f, i, kind, note):
    ours, theirs = f.companions[i].link.codec.statistics, f._drones[i].companion.codec.statistics
    assert ours.unsigned > 5000
    assert theirs.unsigned > 200
    assert ours.received <= theirs.sent
    assert theirs.received <= ours.sent
    unheard(f, i)
    completes(f, i, kind, note)


DETECTIONS = ("nan", "inf", "huge", "raises")


def detector_fails(f, i, kind):
    spoil_detector(f, DETECTIONS[kind], AT, AT + 2.5, i)
    return {}


def check_28(f, i, kind, note):
    """As a blind camera for 2.5 s: slow, then it sees again and goes on."""
    name = DETECTIONS[kind]
    first = [o.verdict.reason for _, o in f.companions[i].ticks(AT + 0.15, AT + 2.4)]
    assert set(first) == {Reason.BLIND}, name
    slow = slow_after(f, i, AT, 0.5)
    assert slow <= 0.6, (name, slow)
    assert f.moved(i, AT + 4.0) > 3.0, name
    note(f"≤ 0.5 m/s, {name}", slow)


def stage_raises(f, i, kind):
    raises(f, [*STAGES][kind], AT, i)
    return {}


def check_29(f, i, kind, note):
    stage = [*STAGES][kind]
    hold = mode_after(f, AT, "HOLD", i)
    assert hold <= 0.25, (stage, hold)
    assert "OFFBOARD" not in modes_from(f, AT + hold + 0.05, i)
    assert not f.companions[i].streamed(AT + 1.5), stage
    note(f"HOLD, {stage}", hold)


AHEAD = (0.05, 0.12, 3600.0, -3600.0)


def check_31(f, i, kind, note):
    """Stamps that cannot be true are refused: HOLD; of the past, as after a restart: silence."""
    ahead, c = AHEAD[kind], f.companions[i]
    flown = {o.verdict.reason for _, o in c.ticks(AT + 0.75) if o.verdict is not None}
    assert Reason.PLAN not in flown, ahead
    if ahead < 0:
        last = max(c.streamed(AT), default=AT) - AT
        assert last <= 0.3
        note("no setpoint, stamps 1 h behind", last)
        return
    hold = mode_after(f, AT, "HOLD", i)
    assert hold <= 1.0
    note(f"HOLD, stamps {ahead:g} s ahead", hold)


def check_33(f, i, kind, note):
    """The lens fogs up."""
    noticed = next(t for t, o in f.companions[i].ticks(AT) if o.fault is CameraFault.UNCLEAR) - AT
    assert noticed <= 0.1 + LATE
    slow, hold = slow_after(f, i, AT, 0.5), mode_after(f, AT, "HOLD", i)
    assert slow <= 1.0
    assert hold <= 5.5
    note("≤ 0.5 m/s", slow)
    note("HOLD", hold)


def check_34(f, i, kind, note):
    truth = f.truth.arrays()
    height = truth["position"][truth["t"] > AT, i, 2].min()
    assert height > 0.7
    completes(f, i, kind, note)
    note("least height over ground [m]", float(height))


def check_35(f, i, kind, note):
    """Completes or holds; that it touches nothing is checked of every drone."""
    assert f.reached(i) >= 1 or modes_from(f, END, i) & {"HOLD", "LAND"}
    note(f"least distance to a trunk [m], {STATES[kind]}", f.room(i))


def check_36(f, i, kind, note):
    c, truth = f.companions[i], f.truth.arrays()
    streams = next(t for t, o in c.ticks(0.0) if o.phase is Phase.ENGAGE)
    taken = next(t for t, o in c.ticks(0.0) if o.phase is Phase.FLY)
    assert taken < AT
    z = truth["position"][(truth["t"] > streams - 0.1) & (truth["t"] < taken + 2.0), i, 2]
    dip = float(min(z[0], 2.0) - z.min())  # below its place; a take-off may end above it
    assert dip <= 0.15, (kind, dip)
    completes(f, i, kind, note)
    note(f"dip [m], thrust × {THRUSTS[kind]:g}", dip)


def one_frame_in_ten_is_lost(f, i, kind):
    rng, last = np.random.default_rng(f.scenario.seed * 10 + i), None

    def drop(inputs):
        nonlocal last
        if last is not None and rng.random() < 0.1:
            return replace(inputs, frame=last)
        last = inputs.frame
        return inputs

    f.companions[i].before = drop
    return {}


def check_39(f, i, kind, note):
    """Drone i is foreign, and gives no way; `check_always` looks at ours among themselves.

    It starts before ours: behind them, it would hit one that climbs or has never looked there.
    """
    for k, c in zip(f.healthy, f.companions, strict=True):
        since = next(t for t, o in c.ticks(0.0) if o.phase is Phase.FLY)
        gap = f.least_distance(i, k, since)
        assert gap > 2.0 * f.scenario.drones.radius, (k, gap)
    figures, name = f.figures(), FOREIGN[kind]["does"]
    there = {n: int(f._reached[n].split("/")[0]) for n in figures["targets_reached"]}
    assert all(there.values()), there
    note(f"least distance of drones [m], one does: {name}", figures["min_agent_distance_m"])


def check_41(f, i, kind, note):
    """Disarmed in flight while the mode stays: nothing is sent from the tick on that hears it."""
    c = f.companions[i]
    shown = next(t for t, o in c.ticks(AT) if o.heartbeat is not None and not o.heartbeat.armed)
    assert shown - AT <= 1.2  # HEARTBEAT: 1 Hz
    assert not [t for t in c.streamed(AT) if t >= shown]
    assert c.outs[-1].phase is Phase.PASSIVE
    note("disarmed: passive (HEARTBEAT: 1 Hz)", shown - AT)


STATES = ("compass 20° off", "telemetry 0.2 s late", "position resets", "GPS", "VIO, resets",
          "RTK, floats")  # fmt: skip
THRUSTS = (0.7, 0.85, 1.2, 1.6)
FOREIGN = ({"does": "hover"}, {"does": "straight", "speed": 1.0}, {"does": "pursue", "speed": 1.0})
ROWS = {
    "26": Row(check_26, ((*one("link_replay", amount=200.0), *one("link_reflect", amount=1.0),
                          *one("link_spoof", amount=50.0)),), listens, options=(SIGNED,)),
    "27": Row(check_27, (one("link_flood", amount=1e7), one("link_garbage", amount=4e6)),
              listens, options=(SIGNED,) * 2),
    "28": Row(check_28, ((),) * len(DETECTIONS), detector_fails),
    "29": Row(check_29, ((),) * len(STAGES), stage_raises, lost=True),
    "30": Row(check_30, ((*one("link_spoof", amount=1000.0), *one("link_forge", amount=50.0)),),
              listens, options=(SIGNED,)),
    "31": Row(check_31, tuple(one("stamps", amount=a) for a in AHEAD), lost=True),
    "33": Row(check_33, (one("camera_fog"),), lost=True),
    "34": Row(check_34, (one("height_drift", amount=1.0), one("height_drift", amount=6.0)),
              options=({"drones.rangefinder": True},) * 2),
    "35": Row(check_35, (one("compass", amount=20.0), one("telemetry_late", amount=0.2),
                         one("position_reset", amount=0.5), (), one("position_reset", amount=0.5),
                         one("rtk_float", **{"for": 4.0})),
              options=({}, {}, {}, *({"drones.state": s} for s in ("gps", "vio", "rtk")))),
    "36": Row(check_36, tuple(({"kind": "thrust_scale", "amount": a},) for a in THRUSTS),
              parameters={"MPC_THR_HOVER": 0.45}),
    "37": Row(completes, ((), ()), one_frame_in_ten_is_lost,
              options=tuple({"timing.compute_delay": d, "timing.compute_jitter": 0.01}
                            for d in (0.02, 0.12))),
    "39": Row(check_39, ((),) * len(FOREIGN), lost=True,
              options=tuple({"drones.foreign": {"drone1": f}} for f in FOREIGN)),
    "40": Row(completes, options=({"mission.levels": [0.0, 0.8], "drones.airframes":
                                   ["quad3", "quad5", "quad7"], "air.downwash": True,
                                   "air.ground_effect": True, "wind.turbulence": "light"},)),
    "41": Row(check_41, (one("kill"),), lost=True),
}  # fmt: skip
