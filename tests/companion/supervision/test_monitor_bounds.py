"""Monitors at their bounds: what just holds, what just does not, and what is forgotten."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.height import Height
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.motion import MotionEstimate
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.prediction import Prediction
from companion.estimation.turns import Turn
from companion.estimation.vehicle import VehicleEstimate
from companion.estimation.velocity_by_sight import VelocityBySight
from companion.supervision.guard import Reaction
from companion.supervision.monitors import MonitorConfig, Monitors
from companion.types import Phase
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import VehicleState

V_MAX = 2.0
SLOW, HOVER, CLIMB, HOLD = Reaction.SLOW, Reaction.HOVER, Reaction.CLIMB, Reaction.HOLD


def vehicle(v=(1.0, 0.0, 0.0), omega=(0.0, 0.0, 0.0), **more):
    level = np.array([1.0, 0.0, 0.0, 0.0])
    own = VehicleState(0.0, np.array([0.0, 0.0, 2.0]), np.array(v), level, np.array(omega))
    return VehicleEstimate(own, **more)


def motion(delay=0.05, disturbance=(0.0, 0.0, 0.0)):
    ahead = Prediction(np.zeros(10), np.zeros(4), np.array(disturbance), delay)
    return MotionEstimate(ahead, HoverEstimate(ThrustMap(), 0.01), Delay(delay, 0.003))


class Watch:
    """Monitors, asked every tenth of a second."""

    def __init__(self, **config):
        self.monitors = Monitors(MonitorConfig(**config), V_MAX)
        self.time = 50.0

    def tick(self, vehicle, motion=motion(), phase=Phase.FLY, dt=0.1):  # noqa: B008
        broken = self.monitors.update(self.time, vehicle, motion, phase)
        self.time += dt
        return broken

    def reactions(self, vehicles):
        found = [self.tick(v) for v in vehicles]
        return [None if b is None else b.reaction for b in found]


def reaction(vehicle, motion=motion(), **config):  # noqa: B008
    broken = Watch(**config).tick(vehicle, motion)
    return None if broken is None else broken.reaction


def test_a_speed_of_half_again_the_highest_is_allowed():
    assert reaction(vehicle((3.0, 0.0, 0.0))) is None
    assert reaction(vehicle((3.01, 0.0, 0.0))) is SLOW
    assert reaction(vehicle((0.0, -2.4, 2.0))) is SLOW
    assert reaction(vehicle((3.5, 0.0, 0.0)), speed_over=1.8) is None


FAST = vehicle((4.0, 0.0, 0.0))
UNSURE = vehicle(doubt=OwnDoubt(velocity=0.51))
LASTING = {"speed": FAST, "doubt": UNSURE}


@pytest.mark.parametrize("name", LASTING)
def test_what_lasts_a_second_and_a_half_asks_for_hold(name):
    assert Watch().reactions([LASTING[name]] * 17) == [SLOW] * 15 + [HOLD] * 2
    assert Watch(persist=0.5).reactions([LASTING[name]] * 7) == [SLOW] * 5 + [HOLD] * 2


@pytest.mark.parametrize("name", LASTING)
def test_what_held_in_between_or_in_another_phase_begins_anew(name):
    bad, good, watch = LASTING[name], vehicle(), Watch()
    assert watch.reactions([bad] * 14 + [good] + [bad] * 14) == [SLOW] * 14 + [None] + [SLOW] * 14
    assert watch.tick(bad, phase=Phase.LAND) is None
    assert watch.reactions([bad] * 14) == [SLOW] * 14


def test_two_things_that_take_turns_do_not_add_up():
    watch = Watch()
    assert watch.reactions([FAST, UNSURE] * 10) == [SLOW] * 20


def test_each_thing_lasts_by_itself():
    both = replace(FAST, doubt=UNSURE.doubt)
    assert Watch().reactions([FAST] * 10 + [both] * 6) == [SLOW] * 15 + [HOLD]


def test_the_gravest_is_told():
    low = Height(0.2, 0.05)
    assert reaction(replace(FAST, height=low)) is CLIMB
    watch = Watch()
    found = [watch.tick(replace(FAST, height=low)) for _ in range(16)]
    assert [b.reaction for b in found] == [CLIMB] * 15 + [HOLD]
    assert [b.finding.partition(":")[0] for b in found] == ["height"] * 15 + ["speed"]


def test_nothing_is_found_without_a_state():
    assert reaction(replace(FAST, state=None)) is None
    watch = Watch()
    assert watch.reactions([FAST] * 10 + [replace(FAST, state=None)] + [FAST] * 5)[-1] is HOLD


@pytest.mark.parametrize(
    ("delay", "found"), [(0.35, None), (0.36, SLOW), (0.5, SLOW), (0.51, HOLD)]
)
def test_a_delay_slows_down_at_one_bound_and_holds_at_another(delay, found):
    assert reaction(vehicle(), motion(delay)) is found


def pushed(watch, size, seconds, dt=0.1):
    """The first time [s] at which a disturbance of so many m/s² is found; None: never."""
    for n in range(round(seconds / dt)):
        if watch.tick(vehicle(), motion(disturbance=(0.0, size, 0.0)), dt=dt):
            return n * dt
    return None


@pytest.mark.parametrize("dt", [0.05, 0.1, 0.2])
def test_a_disturbance_is_averaged_over_two_seconds(dt):
    watch = Watch()
    watch.tick(vehicle(), motion(), dt=dt)
    # 1 − exp(−t / 2 s) of 8 m/s² is 4 m/s² after 1.39 s.
    assert pushed(watch, 8.0, 5.0, dt) == pytest.approx(1.386, abs=0.21)
    assert pushed(Watch(), 3.99, 60.0, dt) is None
    assert pushed(Watch(), -4.3, 60.0, dt) is not None


def test_a_long_gap_between_ticks_counts_as_a_quarter_of_a_second():
    watch = Watch()
    watch.tick(vehicle(), motion(), dt=60.0)
    hard = motion(disturbance=(30.0, 0.0, 0.0))
    assert watch.tick(vehicle(), hard) is None  # 30 m/s² × 0.25 s / 2 s = 3.75 m/s²
    assert watch.tick(vehicle(), hard) is not None


def test_a_first_tick_of_a_flight_may_be_at_any_time():
    watch = Watch()
    assert watch.tick(vehicle(), motion(disturbance=(31.0, 0.0, 0.0))) is None  # a quarter second
    assert Watch().tick(vehicle(), motion(disturbance=(33.0, 0.0, 0.0))) is not None


def test_a_disturbance_that_is_not_known_counts_as_none():
    watch, hard = Watch(), motion(disturbance=(6.0, 0.0, 0.0))
    for _ in range(30):
        watch.tick(vehicle(), hard)
    assert watch.tick(vehicle(), hard).reaction is SLOW
    unknown = replace(hard, prediction=None)
    found = [watch.tick(vehicle(), unknown) for _ in range(10)]
    assert found[-1] is None
    # It begins anew: slow for a second and a half again.
    again = [watch.tick(vehicle(), motion(disturbance=(20.0, 0.0, 0.0))) for _ in range(20)]
    begin = next(n for n, b in enumerate(again) if b)
    assert [b.reaction for b in again[begin : begin + 16]] == [SLOW] * 15 + [HOLD]


def test_a_rejected_sensor_slows_down_and_never_holds_by_itself():
    rejected = vehicle(doubt=OwnDoubt(rejects=True))
    assert Watch().reactions([rejected] * 30) == [SLOW] * 30
    both = vehicle(doubt=OwnDoubt(rejects=True, velocity=0.6))
    assert Watch().reactions([both] * 16) == [SLOW] * 15 + [HOLD]
    assert reaction(vehicle(doubt=OwnDoubt(velocity=0.5))) is None


def test_the_ground_contradicts_for_a_second_and_a_half_before_it_counts():
    wrong = vehicle(by_sight=VelocityBySight(error=np.array([0.8, 0.0, 0.7])))
    right = vehicle(by_sight=VelocityBySight(error=np.array([0.8, 0.0, 0.6])))
    watch = Watch()
    assert watch.reactions([right] * 20) == [None] * 20
    assert watch.reactions([wrong] * 40) == [None] * 15 + [SLOW] * 25
    assert watch.reactions([right] + [wrong] * 16) == [None] * 16 + [SLOW]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("turn", "sigma", "found"), [
    (0.61, 0.0, SLOW), (0.59, 0.0, None), (0.81, 0.1, SLOW), (0.79, 0.1, None),
])  # fmt: skip
def test_a_heading_counts_as_wrong_beyond_twice_its_doubt(side, turn, sigma, found):
    by_sight = VelocityBySight(turn=side * turn, turn_sigma=sigma)
    assert reaction(vehicle(by_sight=by_sight)) is found


@pytest.mark.parametrize(("value", "sigma", "found"), [
    (0.5, 0.0, None), (0.49, 0.3, CLIMB), (0.49, 0.31, None), (-0.2, 0.1, CLIMB),
])  # fmt: skip
def test_a_height_counts_where_it_is_sure(value, sigma, found):
    assert reaction(vehicle(height=Height(value, sigma))) is found


def test_a_drone_that_stays_low_for_three_seconds_holds():
    low, high = vehicle(height=Height(0.3, 0.1)), vehicle(height=Height(1.0, 0.1))
    watch = Watch()
    assert watch.reactions([low] * 31) == [CLIMB] * 30 + [HOLD]
    assert watch.reactions([high] + [low] * 30) == [None] + [CLIMB] * 30
    assert watch.reactions([vehicle()] + [low] * 30) == [None] + [CLIMB] * 30


def rates(axis, *values):
    """A vehicle for each roll (0) or pitch (1) rate [rad/s]."""
    return [vehicle(omega=tuple(np.eye(3)[axis] * value)) for value in values]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [1.5, -1.5])
def test_eight_turns_of_a_rate_within_three_seconds_are_a_swing(axis, side):
    """Of nine rates on alternate sides eight are turns."""
    fast = rates(axis, *[side, -side] * 5)
    assert Watch().reactions(fast[:9]) == [None] * 8 + [SLOW]
    assert Watch(swings=9).reactions(fast) == [None] * 9 + [SLOW]
    assert Watch().reactions(rates(axis, *[1.49, -1.49] * 20)) == [None] * 40
    assert Watch().reactions(rates(axis, *[1.5, 0.0] * 20)) == [None] * 40


def test_rates_in_between_and_longer_turns_count_once():
    swing = [1.6, 1.6, 0.0, -1.6, -0.5, -1.6]  # a turn each three ticks: ten within 3 s
    found = Watch().reactions(rates(0, *swing * 5))
    assert found.index(SLOW) == 24  # the eighth turn
    assert Watch().reactions(rates(2, *[3.0, -3.0] * 20)) == [None] * 40  # it looks round


def test_a_slow_swing_is_none():
    slow = [v for side in [1.6, -1.6] * 10 for v in [side] * 5]  # a turn each half second: 7 in 3 s
    assert set(Watch().reactions(rates(1, *slow))) == {None}


def test_axes_are_counted_apart():
    one = [v for pair in zip(rates(0, *[2.0, -2.0] * 4), rates(1, *[2.0, -2.0] * 4)) for v in pair]  # noqa: B905
    assert Watch().reactions(one[:12]) == [None] * 12


def test_a_swing_hovers_and_holds_only_where_it_goes_on_in_hover():
    fast, still = rates(0, *[2.0, -2.0] * 30), rates(0, *[0.0] * 30)
    watch = Watch()
    found = watch.reactions(fast[:40])
    assert found == [None] * 8 + [SLOW] * 15 + [HOVER] * 15 + [HOLD] * 2
    watch = Watch()
    found = watch.reactions(fast[:24] + still)
    assert found[:24] == [None] * 8 + [SLOW] * 15 + [HOVER]
    assert HOLD not in found
    assert found[-1] is None  # three seconds after the last
    # Half of what began it goes on: four turns in a second and a half.
    lively = [v for side in [2.0, -2.0] * 12 for v in rates(0, side, side, side)]
    assert HOLD in Watch().reactions(fast[:24] + lively[:24])
    dull = [v for side in [2.0, -2.0] * 12 for v in rates(0, *[side] * 5)]
    assert HOLD not in Watch().reactions(fast[:24] + dull)


def turn(time, off, spread=0.0, follows=True):
    return Turn(time, 0.1, follows, off, spread, 0.0)


def turned(*turns):
    return vehicle(turns=turns)


@pytest.mark.parametrize(
    ("off", "found"),
    [((0.34, 0.0, 0.0), None), ((0.36, 0.0, 0.0), HOLD), ((0.0, -0.27, 0.21), None),
     ((0.0, -0.29, 0.21), HOLD), ((0.0, 0.0, -0.36), HOLD)],
)  # fmt: skip
def test_gyro_and_attitude_may_differ_by_twenty_degrees(off, found):
    assert reaction(turned(turn(1.0, off))) is found


def test_turns_of_a_second_are_added_with_their_signs():
    watch = Watch()
    a, b = (0.2, 0.0, 0.0), (-0.2, 0.0, 0.0)
    assert watch.reactions([turned(turn(1.0, a), turn(1.1, b), turn(1.2, a))]) == [None]
    assert watch.reactions([turned(turn(2.0, a))]) == [HOLD]  # those of 1.0 s still count
    watch = Watch()
    assert watch.reactions([turned(turn(1.0, a)), turned(turn(2.01, a))]) == [None, None]
    assert watch.reactions([turned(turn(2.02, a))]) == [HOLD]


def test_turns_before_a_gap_do_not_count():
    watch = Watch()
    first, second = turn(1.0, (0.3, 0.0, 0.0)), turn(1.5, (0.3, 0.0, 0.0), follows=False)
    assert watch.reactions([turned(first), turned(second)]) == [None, None]
    assert watch.reactions([turned(turn(1.6, (0.1, 0.0, 0.0)))]) == [HOLD]


def test_what_sparse_samples_leave_open_is_allowed_for():
    sparse = turn(1.0, (0.5, 0.0, 0.0), spread=0.1)  # 0.35 + 2 × 0.1
    assert reaction(turned(sparse)) is None
    assert reaction(turned(replace(sparse, off=(0.56, 0.0, 0.0)))) is HOLD
    three = [turn(1.0 + 0.1 * n, (0.19, 0.0, 0.0), spread=0.06) for n in range(3)]
    both = math.sqrt(3 * 0.06**2)
    assert 0.35 + 2.0 * both < 0.57 < 0.35 + 2.0 * 3 * 0.06
    assert reaction(turned(*three)) is HOLD


def test_a_finding_of_the_gyro_lasts_until_its_second_has_passed():
    watch = Watch()
    assert watch.reactions([turned(turn(1.0, (0.5, 0.0, 0.0))), vehicle()]) == [HOLD, HOLD]
    assert watch.reactions([turned(turn(2.01, (0.0, 0.0, 0.0)))]) == [None]


def slid(*ways):
    return [vehicle(slid=np.array([0.0, way, 0.0])) for way in ways]


def test_a_position_may_slide_by_a_metre_in_three_seconds():
    assert Watch().reactions(slid(5.0, 6.0, 6.01, 4.0)) == [None, None, SLOW, None]
    assert Watch().reactions(slid(5.0, 3.99)) == [None, SLOW]
    slow = [0.033 * n for n in range(100)]
    assert set(Watch().reactions(slid(*slow))) == {None}
    step = [0.0] * 10 + [1.2] * 40
    found = Watch().reactions(slid(*step))
    assert found[:39] == [None] * 10 + [SLOW] * 29
    assert found[40:] == [None] * 10
