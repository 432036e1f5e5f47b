"""Rows 1 to 25 of the fault matrix in the paper's forest: the faults of a drone, and its reaction.

Faults begin at `AT`, in full flight between the first trunks.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.perception.camera_health import CameraFault
from companion.supervision.guard import AutopilotRequest, Reason
from companion.types import Phase
from tests.closed_loop.matrix.checks import OFFBOARD
from tests.closed_loop.matrix.measures import (
    completes,
    first_with,
    hovers,
    mode_after,
    modes_from,
    slow_after,
)
from tests.closed_loop.matrix.strikes import (
    AT,
    bad_solves,
    fence_moves,
    killed,
    not_numbers,
    released,
)

LATE = 0.02  # s, period of telemetry: the resolution of measured times


@dataclass(frozen=True)
class Row:
    """check(flight, i, kind, note): asserts the reaction of drone i to faults[kind].

    faults: alternatives, each the faults of one drone. strike(flight, i, kind): disturbances that
    no scenario has. lost: the drone loses its companion or its control, so it counts as not
    healthy. parameters: of the autopilots. options: of the scenario, for each kind in turn.
    """

    check: Callable
    faults: tuple = ((),)
    strike: Callable = lambda flight, i, kind: None
    lost: bool = False
    parameters: dict = field(default_factory=dict)
    options: tuple = ()

    def __post_init__(self):
        object.__setattr__(self, "options", self.options or ({},) * len(self.faults))


def passive(f, i, since):
    """Assert that from `since` on the companion requests nothing, and offboard is not entered."""
    assert f.companions[i].outs[-1].phase is Phase.PASSIVE
    assert not f.companions[i].streamed(since)
    until = landed(f, i, since)
    assert "OFFBOARD" not in {name for t, name in f.modes[i] if since < t < until}


def landed(f, i, since):
    """When drone i is first on the ground after `since` [s of flight]; inf: it is not.

    A PX4 that has landed and disarmed shows the mode of before, which is offboard.
    """
    truth = f.truth.arrays()
    grounded = truth["t"][(truth["t"] > since) & (truth["position"][:, i, 2] < 0.2)]
    return float(grounded[0]) if len(grounded) else np.inf


# --- rows ---------------------------------------------------------------------------------


def check_1(f, i, kind, note):
    hold = mode_after(f, AT + 0.05, "HOLD", i) + 0.05
    assert hold <= 0.6 + LATE
    assert "OFFBOARD" not in modes_from(f, AT + hold + 0.05, i)
    hovers(f, i, AT + 4.0)
    note("HOLD", hold)


def check_2(f, i, kind, note):
    """A tick that takes 1.5 s: silence, HOLD; control is not taken back when it ends."""
    hold = mode_after(f, AT, "HOLD", i)
    assert hold <= 0.1 + 0.6 + LATE
    passive(f, i, AT + 1.5 + 1.2)  # a heartbeat comes once a second
    note("HOLD", hold)


def check_3(f, i, kind, note):
    reasons = [o.verdict.reason for t, o in f.companions[i].ticks(AT) if o.verdict is not None]
    assert reasons.count(Reason.SHIFTED_PLAN) >= 15
    assert Reason.BRAKE not in reasons
    completes(f, i, kind, note)


def check_4(f, i, kind, note):
    first = first_with(f.companions[i], AT, Reason.SHIFTED_PLAN)
    reasons = [o.verdict.reason for _, o in f.companions[i].ticks(first, first + 1.15)]
    assert reasons == [Reason.SHIFTED_PLAN] * 2 + [Reason.BRAKE] * 10
    slow = slow_after(f, i, first, 0.3)
    assert slow < 1.2
    completes(f, i, kind, note)
    note("slower than 0.3 m/s", slow)


def check_5(f, i, kind, note):
    first = first_with(f.companions[i], AT, Reason.SHIFTED_PLAN)
    land = mode_after(f, first, "LAND", i)
    assert land <= 2.2
    passive(f, i, first + land + 1.2)
    note("LAND", land)


def check_6(f, i, kind, note):
    c = f.companions[i]
    assert {o.verdict.request for o in c.outs if o.verdict} == {AutopilotRequest.NONE}
    assert c.companion._vehicle._own.counters.not_finite > 50
    assert all(np.isfinite(t.P).all() and np.isfinite(t.p).all() for o in c.outs for t in o.tracks)
    completes(f, i, kind, note)


def check_7(f, i, kind, note):
    stopped = first_with(f.companions[i], AT, Reason.NO_STATE) - AT
    hold = mode_after(f, AT, "HOLD", i)
    assert stopped <= 0.4
    assert hold <= 0.45
    note("HOLD", hold)


def check_silence(f, i, kind, note):
    c = f.companions[i]
    land = (
        next(t for t, o in c.ticks(AT) if o.verdict and o.verdict.request is AutopilotRequest.LAND)
        - AT
    )
    end = c.streamed(AT)[-1] - AT
    assert 0.95 <= land <= 1.1 + LATE
    assert 1.85 <= end <= 2.1
    assert modes_from(f, AT + 2.0, i, until=landed(f, i, AT + 2.0)) <= {"HOLD", "LAND"}
    note("LAND asked for", land)
    note("silent", end)


def check_8(f, i, kind, note):
    land = mode_after(f, AT, "LAND", i)
    assert land <= 0.4 + LATE
    reasons = {o.verdict.reason for _, o in f.companions[i].ticks(AT + 0.4) if o.verdict}
    assert not reasons & {Reason.PLAN, Reason.SHIFTED_PLAN}
    note("LAND, " + ("position_jump", "position_lost", "quaternion")[kind], land)


def check_half(f, i, kind, note):
    """Half of all packets lost: no tumbling, and the vehicle holds by itself.

    Two autopilots that hold side by side see nobody, and drift: what counts is until both hold.
    """
    assert f.most_tilt(AT, i) < 45.0
    hold = mode_after(f, AT, "HOLD", i)
    assert hold <= 8.0
    note("HOLD at 50 %", hold)
    radius = f.scenario.drones.radius
    assert f.room(i) > radius
    assert f.lowest_in_offboard(i) > 0.5
    for k in range(i):
        both = AT + max(hold, mode_after(f, AT, "HOLD", k))
        gap = f.least_distance(i, k, 0.0, until=both + 1.0)
        assert gap > 2.0 * radius, (i, k, gap)


def check_13(f, i, kind, note):
    c = f.companions[i]
    shown = next(
        t
        for t, o in c.ticks(AT)
        if o.heartbeat is not None
        and (not o.heartbeat.armed or o.heartbeat.custom_mode != OFFBOARD)
    )
    assert shown - AT <= 1.2  # HEARTBEAT: 1 Hz
    passive(f, i, shown + 0.05)


def check_14(f, i, kind, note):
    c = f.companions[i]
    last = max(c.streamed(AT), default=AT) - AT
    assert last <= 0.2
    assert c.companion._vehicle._own.counters.reboots == 1
    assert c.outs[-1].phase is Phase.PASSIVE
    assert c.outs[-1].own is not None
    note("no setpoint after", last)


TROUBLES = (("camera_dead", CameraFault.DEAD), ("camera_frozen", CameraFault.FROZEN),
            ("camera_black", CameraFault.BLACK), ("camera_saturated", CameraFault.SATURATED),
            ("camera_late", CameraFault.LATE))  # fmt: skip


def check_15(f, i, kind, note):
    """Blind for 2.5 s: noticed, slow, hover; then it sees again and goes on."""
    name, trouble = TROUBLES[kind]
    late = 0.1 * (name == "camera_late")
    noticed = next(t for t, o in f.companions[i].ticks(AT) if o.fault is trouble) - AT
    assert noticed <= 0.1 + late + LATE, name
    slow = slow_after(f, i, AT, 0.5)
    assert slow <= 0.5 + late + 0.1, (name, slow)  # up to a tick before it can be noticed
    truth = f.truth.arrays()
    blind = (truth["t"] >= AT + 2.0) & (truth["t"] < AT + 2.5)
    assert np.linalg.norm(truth["velocity"][blind, i], axis=1).max() < 0.25, name
    assert f.moved(i, AT + 4.0) > 3.0, name
    note(f"≤ 0.5 m/s, {name}", slow)


def check_17(f, i, kind, note):
    others = [k for k in f.healthy if k != i]
    apart = min(f.least_distance(i, k, AT) for k in others)
    assert apart > 2 * f.scenario.drones.radius, apart
    note(f"least distance [m], {('stop', 'turn_into', 'kill')[kind]}", apart)


def check_21(f, i, kind, note):
    axis, way, limit = f.fences[i]
    ticks = f.companions[i].ticks(AT)
    braking = next(t for t, o in ticks if o.verdict and o.verdict.reason is Reason.FENCE) - AT
    assert braking <= 0.1 + LATE
    beyond = max(way * (o.own.p[axis] - limit) for _, o in ticks if o.own is not None)
    assert beyond < 2.0
    verdicts = [o.verdict for _, o in ticks if o.verdict and o.verdict.reason is Reason.FENCE]
    if any(v.request is AutopilotRequest.LAND for v in verdicts):  # over it by more than a metre
        assert f.truth.arrays()["position"][-1, i, 2] < 0.3
    else:
        assert way * (ticks[-1][1].own.p[axis] - limit) < 0.0  # it came back
    note("brakes outside", braking)
    note("stops within [m]", beyond)


def check_22(f, i, kind, note):
    landed = f.truth.arrays()["position"][-1, i, 2] < 0.3
    if not landed:
        completes(f, i, kind, note)


def check_24(f, i, kind, note):
    hold = mode_after(f, AT, "HOLD", i)
    assert hold <= 2.0
    passive(f, i, AT + 2.0)
    note("HOLD", hold)


def check_25(f, i, kind, note):
    c = f.companions[i]
    back = AT + 3.0
    heard = next(t for t, o in c.ticks(back) if o.phase is Phase.PASSIVE) - back
    assert heard <= 2.0
    passive(f, i, back + heard + 0.05)
    note("passive after the line is back", heard)


def unmoved(f, i, kind, note):
    """Exactly as without the fault (three drones); nine: the mission goes on."""
    completes(f, i, kind, note)
    if len(f.names) == 3:
        assert np.array_equal(f.truth.arrays()["position"], f.undisturbed())


def one(kind, **more):
    """Drone faults of one kind from AT on."""
    return ({"kind": kind, "at": AT, **more},)


OF_LOSS = {"COM_OF_LOSS_T": 0.5}
ROWS = {
    "1": Row(check_1, strike=killed, lost=True, parameters=OF_LOSS),
    "2": Row(check_2, (one("pause", amount=1.5, **{"for": 0.1}),), lost=True, parameters=OF_LOSS),
    "3": Row(check_3, strike=bad_solves(range(0, 999, 10))),
    "4": Row(check_4, strike=bad_solves(range(12))),
    "5": Row(check_5, strike=bad_solves(range(999)), lost=True),
    "6": Row(check_6, (one("telemetry_nan", amount=0.3),), not_numbers),
    "7": Row(check_7, (one("telemetry_stale"),), lost=True),
    "7_silence": Row(check_silence, (one("link_loss", amount=1.0),), lost=True),
    "8": Row(check_8, (one("position_jump", amount=3.0), one("position_lost"),
                       one("quaternion", amount=0.5)), lost=True),
    "9": Row(completes, (one("link_loss", amount=0.2), one("link_duplicate", amount=0.3),
                         one("link_reorder", amount=0.3), one("link_flip", amount=0.2),
                         one("link_loss", amount=0.05))),
    "9_half": Row(check_half, (one("link_loss", amount=0.5),), lost=True),
    "10": Row(completes, (one("link_garbage", amount=1e6), one("link_foreign", amount=200.0))),
    "13": Row(check_13, (one("mode", to="position"), one("kill"), one("mode", to="land")),
              lost=True),
    "14": Row(check_14, (one("reboot"),), lost=True),
    "15": Row(check_15, tuple(one(k, **{"for": 2.5}) for k, _ in TROUBLES)),
    "16": Row(completes, ((*one("missed", amount=0.3), *one("ghosts", amount=0.05),
                           *one("swaps", amount=0.2), *one("range_bias", amount=1.2)),)),
    "17": Row(check_17, (one("stop"), one("turn_into"), one("kill")), lost=True),
    "18": Row(unmoved, (one("clock_jump", amount=3600.0), one("clock_jump", amount=-3600.0),
                        one("timesync_jump", amount=0.5))),
    "19": Row(completes, (one("pause", amount=0.2, **{"for": 2.0}), one("pause", amount=0.07))),
    "21": Row(check_21, strike=fence_moves),
    "22": Row(check_22, (one("motor", amount=0.8), one("thrust_scale", amount=0.8),
                         one("thrust_scale", amount=1.2),
                         one("gust", amount=5.0, **{"for": 3.0}),
                         one("gyro_bias", amount=0.05))),
    "22_battery": Row(check_22, (one("battery", amount=0.05),), lost=True),
    "24": Row(check_24, strike=released, lost=True),
    "25": Row(check_25, (one("link_loss", amount=1.0, **{"for": 3.0}),), lost=True),
}  # fmt: skip
