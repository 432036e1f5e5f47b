"""Monitors: each assumption that is broken is noticed, and named; a good flight is left alone."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.height import Height
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.motion import MotionEstimate
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.prediction import Prediction
from companion.estimation.turns import UnexplainedTurns
from companion.estimation.vehicle import VehicleEstimate
from companion.estimation.velocity_by_sight import VelocityBySight
from companion.supervision.guard import (
    AutopilotRequest,
    Broken,
    Guard,
    GuardInputs,
    Reaction,
    Reason,
)
from companion.supervision.guard_config import GuardConfig
from companion.supervision.monitors import MonitorConfig, Monitors
from companion.types import Phase, Plan, PlanStatus
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import integrate
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Attitude, VehicleState

V_MAX = 1.85
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def state(time, v=(1.5, 0.0, 0.0), q=LEVEL, omega=(0.0, 0.0, 0.0)):
    """The own state 2 m high."""
    return VehicleState(time, np.array([0.0, 0.0, 2.0]), np.array(v), q, np.array(omega))


def motion(delay=0.05, disturbance=(0.3, 0.0, 0.2)):
    """The estimate of a drone that flies by its model."""
    prediction = Prediction(np.zeros(10), np.zeros(4), np.array(disturbance), delay)
    return MotionEstimate(prediction, HoverEstimate(ThrustMap(), 0.01), Delay(delay, 0.003))


def watched(seconds, vehicle_at, motion_at=lambda t: motion(), phase=Phase.FLY):
    """The findings of each tick of a flight: time [s] and what is broken."""
    monitors, found = Monitors(MonitorConfig(), V_MAX), []
    turns = UnexplainedTurns()
    for tick in range(round(10 * seconds)):
        t = 0.1 * tick
        vehicle = vehicle_at(t)
        vehicle = replace(vehicle, turns=tuple(turns.update(vehicle.attitudes)))
        broken = monitors.update(t, vehicle, motion_at(t), phase)
        if broken is not None:
            found.append((t, broken))
    return found


def weaving(t):
    """A drone that weaves and sweeps its gaze, whose gyro tells each turn."""
    q, dt = LEVEL, 0.01
    for s in np.arange(0.0, t, dt):
        q = integrate(q, turning(s), dt)
    return state(t, q=q, omega=turning(t))


def turning(t):
    return np.array([0.9 * np.sin(4.0 * t), 0.9 * np.cos(4.0 * t), 2.0 * np.sin(2.5 * t)])


def told(s):
    """The estimate of a state that telemetry has just told."""
    attitude = Attitude(s.time, s.q_wb, s.omega)
    return VehicleEstimate(s, attitudes=(attitude,), height=Height(2.0, 0.1))


def test_a_lively_flight_breaks_nothing():
    assert watched(6.0, lambda t: told(weaving(t))) == []


def test_nothing_is_watched_before_and_after_the_mission():
    fast = VehicleEstimate(state(0.0, v=(9.0, 0.0, 0.0)))
    assert watched(3.0, lambda t: fast, phase=Phase.LAND) == []


BROKEN = {
    "speed": (lambda t: VehicleEstimate(state(t, v=(3.5, 0.0, 0.0))), lambda t: motion()),
    "model": (
        lambda t: VehicleEstimate(state(t)),
        lambda t: motion(disturbance=(6.0, 0.0, 0.0)),
    ),
    "delay": (lambda t: VehicleEstimate(state(t)), lambda t: motion(0.3 + 0.1 * t)),
    "gyro": (
        lambda t: told(state(t, omega=(0.0, 0.0, 0.8))),  # and the attitude stands
        lambda t: motion(),
    ),
    "swing": (
        lambda t: VehicleEstimate(
            state(t, omega=(2.0 * np.sin(2 * np.pi * 2.0 * t + 0.5), 0.0, 0.0))
        ),
        lambda t: motion(),
    ),
    "doubt": (
        lambda t: VehicleEstimate(state(t), doubt=OwnDoubt(velocity=0.8)),
        lambda t: motion(),
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_assumption_is_named_and_ends_in_hold(name):
    found = watched(6.0, *BROKEN[name])
    holds = [t for t, b in found if b.reaction is Reaction.HOLD]
    assert holds
    assert holds[0] < (5.5 if name == "swing" else 4.0)  # it is slow and hovers before
    assert all(b.finding.startswith(name) for t, b in found if t in holds)


@pytest.mark.parametrize(("surprises", "reaction"), [(5, None), (6, Reaction.HOLD)])
def test_neighbours_that_come_up_close_by_time_after_time_end_in_hold(surprises, reaction):
    vehicle = VehicleEstimate(state(0.0))
    monitors = Monitors(MonitorConfig(), V_MAX)
    broken = monitors.update(0.0, vehicle, motion(), Phase.FLY, surprises=surprises)
    assert (broken and broken.reaction) is reaction
    assert broken is None or broken.finding.startswith("eyes: 6 neighbours")


@pytest.mark.parametrize(
    ("upsets", "reaction"), [(4, None), (5, Reaction.SLOW), (9, Reaction.SLOW), (10, Reaction.HOLD)]
)
def test_trunks_that_move_or_vanish_make_the_drone_slow_and_then_hold(upsets, reaction):
    vehicle = VehicleEstimate(state(0.0))
    monitors = Monitors(MonitorConfig(), V_MAX)
    broken = monitors.update(0.0, vehicle, motion(), Phase.FLY, upsets=upsets)
    assert (broken and broken.reaction) is reaction
    assert broken is None or broken.finding == f"map: {upsets} known trunks have moved or vanished"


def test_a_drone_that_swings_flies_slowly_and_hovers_before_it_holds():
    """Between many neighbours the plan itself swings; with GPS, HOLD drifts into trunks."""
    found = watched(6.0, *BROKEN["swing"])
    first = {
        r: next(t for t, b in found if b.reaction is r) for r in {b.reaction for _, b in found}
    }
    assert set(first) == {Reaction.SLOW, Reaction.HOVER, Reaction.HOLD}
    assert first[Reaction.SLOW] == found[0][0]
    assert first[Reaction.HOVER] - found[0][0] == pytest.approx(1.5, abs=0.11)
    assert first[Reaction.HOLD] - found[0][0] == pytest.approx(3.0, abs=0.11)


def test_a_plan_that_swings_is_flown_again_after_a_hover():
    vehicle_at, motion_at = BROKEN["swing"]
    quiet = first = None

    def hovers(t):  # the guard's brake ends the swing
        return vehicle_at(t) if quiet is None or t < quiet else VehicleEstimate(state(t))

    first = watched(6.0, hovers, motion_at)
    quiet = next(t for t, b in first if b.reaction is Reaction.HOVER)
    found = watched(9.0, hovers, motion_at)
    assert {b.reaction for _, b in found} == {Reaction.SLOW, Reaction.HOVER}
    assert found[-1][0] < quiet + 3.0


def test_a_position_that_slides_slows_the_drone_and_is_forgotten():
    def sliding(t):
        way = np.array([min(max(t - 2.0, 0.0), 2.0), 0.0, 0.0])
        return VehicleEstimate(state(t), slid=way, map_offset=way)

    found = watched(9.0, sliding)
    assert {b.reaction for _, b in found} == {Reaction.SLOW}
    assert found[0][0] == pytest.approx(3.1, abs=0.11)
    assert found[-1][0] < 7.1


def test_a_rejected_sensor_slows_the_drone():
    found = watched(3.0, lambda t: VehicleEstimate(state(t), doubt=OwnDoubt(rejects=True)))
    assert {b.reaction for _, b in found} == {Reaction.SLOW}


def test_a_velocity_that_the_ground_contradicts_slows_the_drone_and_never_asks_for_hold():
    def contradicted(t):
        wrong = np.array([0.0, 1.2 if 1.0 <= t < 6.0 else 0.8, 0.0])
        return VehicleEstimate(state(t), by_sight=VelocityBySight(error=wrong))

    found = watched(9.0, contradicted)
    assert {b.reaction for _, b in found} == {Reaction.SLOW}
    assert all(b.finding.startswith("sight") for _, b in found)
    assert (found[0][0], found[-1][0]) == pytest.approx((2.5, 5.9), abs=0.11)


def test_a_heading_that_the_ground_contradicts_slows_the_drone():
    def turned(t):
        by_sight = VelocityBySight(turn=-0.7 if 1.0 <= t < 3.0 else 0.63, turn_sigma=0.02)
        return VehicleEstimate(state(t), by_sight=by_sight)

    found = watched(5.0, turned)
    assert {b.reaction for _, b in found} == {Reaction.SLOW}
    assert found[0][1].finding == "heading: wrong by -40°"
    assert (found[0][0], found[-1][0]) == pytest.approx((1.0, 2.9), abs=0.11)


def test_near_the_ground_the_drone_climbs_and_then_holds():
    def low(t):
        return VehicleEstimate(state(t), height=Height(0.3, 0.03))

    found = watched(4.0, low)
    assert found[0][1].reaction is Reaction.CLIMB
    assert found[-1][1].reaction is Reaction.HOLD
    unsure = replace(low(0.0), height=Height(0.3, 0.6))
    assert watched(4.0, lambda t: unsure) == []


def judged(reaction, v=(0.0, 0.0, 0.0)):
    """The guard's verdict where an assumption is broken, with a plan that climbs."""
    u = np.tile([12.0, 0.0, 0.0, 0.0], (2, 1))
    plan = Plan(np.zeros((3, 10)), u, PlanStatus.SOLVED, True, 2, 0.001, 0.0, 0, 0, 0, (), 1.0)
    inputs = GuardInputs(
        1.0, plan, state(1.0, v=v), age=0.02, tick_gap=0.1, broken=Broken("speed: …", reaction)
    )
    return Guard(GuardConfig()).judge(inputs)


def test_the_guard_flies_slowly_climbs_or_holds():
    slow, fast = judged(Reaction.SLOW), judged(Reaction.SLOW, v=(1.5, 0.0, 0.0))
    assert slow.reason is fast.reason is Reason.ASSUMPTION
    assert slow.command.c == 12.0
    assert fast.command.omega[1] < -0.5  # it brakes
    climb = judged(Reaction.CLIMB)
    assert climb.command.c > GRAVITY + 1.0
    assert climb.request is AutopilotRequest.NONE
    hold = judged(Reaction.HOLD, v=(1.5, 0.0, 0.0))
    assert hold.request is AutopilotRequest.HOLD
    assert hold.command.omega[1] < -0.5


def test_eyes_that_show_no_trunk_where_one_is_known_slow_the_drone_down_and_then_hold_it():
    monitors = Monitors(MonitorConfig(), V_MAX)
    found = [
        monitors.update(0.1 * k, VehicleEstimate(state(0.1 * k)), motion(), Phase.FLY, k != 3)
        for k in range(20)
    ]
    reactions = [None if b is None else b.reaction for b in found]
    assert reactions == 3 * [Reaction.SLOW] + [None] + 15 * [Reaction.SLOW] + [Reaction.HOLD]
    assert found[-1].finding == "eyes: no trunk is seen where one is known"


def test_a_drone_that_has_seen_none_of_the_others_says_so_after_a_turn_and_then_holds():
    monitors = Monitors(MonitorConfig(alone=6.0), V_MAX)
    found = [
        monitors.update(0.1 * k, VehicleEstimate(state(0.1 * k)), motion(), Phase.FLY, alone=k < 65)
        for k in range(70)
    ]
    reactions = [None if b is None else b.reaction for b in found]
    slow, hold = [Reaction.SLOW], [Reaction.HOLD]
    assert reactions == 40 * [None] + 20 * slow + 5 * hold + 5 * [None]
    assert found[50].finding == "others: none has been seen steadily, and some started within sight"


def test_a_speed_that_was_allowed_in_between_begins_anew():
    monitors = Monitors(MonitorConfig(), V_MAX)
    for k in range(25):
        v = (1.5 if k == 12 else 3.5, 0.0, 0.0)
        broken = monitors.update(0.1 * k, VehicleEstimate(state(0.1 * k, v=v)), motion(), Phase.FLY)
        assert (broken is None) == (k == 12)
        assert broken is None or broken.reaction is Reaction.SLOW
