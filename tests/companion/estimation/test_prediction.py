"""Prediction: inputs in flight, and the disturbance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import StatePredictor
from companion.model import HOVER, predict
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import VehicleState

DELAY = 0.06


class Predictor(StatePredictor):
    """A predictor with a history of its own."""

    def __init__(self, delay, drag=0.0):
        self.history = InputHistory(delay)
        super().__init__(self.history, drag)

    def sent(self, time, u):
        self.history.add(SentInput(time, u, 0.0))


def vehicle(time, x):
    return VehicleState(time, x[:3], x[3:6], x[6:10], np.zeros(3))


def rest():
    x = np.zeros(10)
    x[6] = 1.0
    return x


def test_an_input_acts_after_its_delay():
    f = Predictor(DELAY)
    strong = np.array([GRAVITY + 4.0, 0.0, 0.0, 0.0])
    f.sent(0.0, HOVER)
    f.sent(0.1, strong)
    ahead = f.ahead(vehicle(0.1, rest()))  # the strong input acts from 0.16 on, not before
    assert ahead[5] == pytest.approx(0.0, abs=1e-9)
    f.sent(0.2, HOVER)
    ahead = f.ahead(vehicle(0.2, rest()))
    assert ahead[5] == pytest.approx(4.0 * DELAY)


def test_a_long_delay_holds_several_inputs_in_flight():
    f = Predictor(0.25)
    for k, extra in enumerate([1.0, 2.0, 4.0]):
        f.sent(0.1 * k, np.array([GRAVITY + extra, 0.0, 0.0, 0.0]))
    ahead = f.ahead(vehicle(0.25, rest()))  # to 0.5: 1.0 to 0.35, 2.0 to 0.45, 4.0 after
    assert ahead[5] == pytest.approx(0.1 * 1.0 + 0.1 * 2.0 + 0.05 * 4.0)


def test_the_history_holds_the_longest_delay_at_the_shortest_period():
    f = Predictor(0.5)
    for k in range(50):
        f.sent(0.02 * k, np.array([GRAVITY + (k < 26), 0.0, 0.0, 0.0]))
    ahead = f.ahead(vehicle(0.98, rest()))  # to 1.48: 26 of 50 were strong, the last until 1.02
    assert ahead[5] == pytest.approx(1.02 - 0.98)


def test_drag_is_learnt_as_a_disturbance():
    f, x, drag = Predictor(DELAY), rest(), np.array([-0.4, 0.2, 0.0])
    f.sent(-0.1, HOVER)
    for k in range(100):
        f.observe(vehicle(0.1 * k, x))
        f.sent(0.1 * k, HOVER)
        x = predict(x, HOVER, 0.1, drag)
    assert f.disturbance == pytest.approx(drag, abs=0.01)


def test_no_disturbance_is_learnt_while_the_autopilot_flies_by_itself():
    f, x = Predictor(DELAY), rest()
    for k in range(20):
        f.history.clear()
        f.observe(vehicle(0.1 * k, x))
        x = predict(x, HOVER, 0.1, np.array([1.0, 0.0, 0.0]))
    assert np.array_equal(f.disturbance, np.zeros(3))


def test_drag_that_is_known_is_no_disturbance():
    """A gust of drag changes with the speed at once, and so does the prediction."""
    f, x, drag = Predictor(DELAY, drag=0.3), rest(), 0.3
    x[3:6] = 1.5, -0.5, 0.4
    f.sent(-0.1, HOVER)
    for k in range(100):
        f.observe(vehicle(0.1 * k, x))
        f.sent(0.1 * k, HOVER)
        for _ in range(10):
            x = predict(x, HOVER, 0.01, -drag * np.array([x[3], x[4], 0.0]))
        x[3:6] = np.roll(x[3:6], 1) if k == 50 else x[3:6]
    assert f.disturbance == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    told = f.update(vehicle(10.0, x))
    assert told.disturbance[:2] == pytest.approx(-drag * x[3:5], abs=0.02)
    assert told.disturbance[2] == pytest.approx(0.0, abs=0.02)


def _turn(axis):
    """Return the attitude q_wb (4,) that turns the thrust axis up to `axis` (3,), without yaw."""
    q = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return q / np.linalg.norm(q)


ACCELERATIONS = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


@given(wind=ACCELERATIONS, motion=ACCELERATIONS, gap=st.sampled_from([0.05, 0.1, 0.2]))
def test_the_wind_is_known_before_the_own_inputs_fly(wind, motion, gap):
    """While an autopilot holds or accelerates, by whatever thrust, wind shows in its tilt."""
    wind[2] = 0.0  # what pushes up or down, its thrust has made up for
    axis = motion - wind + [0.0, 0.0, GRAVITY]
    f, x = Predictor(DELAY), rest()
    x[6:] = _turn(axis / np.linalg.norm(axis))
    for k in range(80):
        f.watch(vehicle(gap * k, x))
        x = x.copy()
        x[3:6] += gap * motion
    assert f.disturbance == pytest.approx(wind, abs=0.02)


def test_an_upset_vehicle_tells_nothing_of_the_wind():
    f, x = Predictor(DELAY), rest()
    x[6:] = _turn(np.array([0.7, 0.0, 0.714]))
    for k in range(20):
        f.watch(vehicle(0.1 * k, x))
    assert not f.disturbance.any()


EAST = np.array([0.05, 0.0, 0.0])  # m/s


def one_tick(dt=0.1, sent=True, faster=EAST, drag=0.0):
    """Return the disturbance by one tick of level flight that grows `faster` (3,) m/s."""
    f, x = Predictor(DELAY, drag), rest()
    if sent:
        f.sent(0.0, HOVER)
    f.observe(vehicle(1.0, x))
    x = x.copy()
    x[3:6] = faster
    f.observe(vehicle(1.0 + dt, x))
    return f.disturbance


def test_a_tenth_of_what_the_inputs_do_not_explain_is_learnt_at_each_tick():
    assert one_tick() == pytest.approx([0.1 * 0.5, 0.0, 0.0])
    assert one_tick(faster=np.array([0.0, 0.05, -0.1])) == pytest.approx([0.0, 0.05, -0.1])


@pytest.mark.parametrize(("dt", "learnt"), [(0.24, True), (0.26, False), (-0.05, False)])
def test_states_far_apart_or_out_of_order_tell_no_disturbance(dt, learnt):
    assert one_tick(dt).any() == learnt


def test_without_inputs_there_is_nothing_to_compare_with():
    assert not one_tick(sent=False).any()


@pytest.mark.parametrize("forgets", [True, False])
def test_motion_since_before_the_inputs_were_forgotten_tells_nothing(forgets):
    f, x = Predictor(DELAY), rest()
    f.sent(0.0, HOVER)
    f.observe(vehicle(1.0, x))
    if forgets:
        f.history.clear()
    f.sent(1.0, HOVER)
    x = x.copy()
    x[3] = 0.05
    f.observe(vehicle(1.1, x))
    assert f.disturbance.any() != forgets
    x = x.copy()
    x[3] = 0.1
    f.observe(vehicle(1.2, x))
    assert f.disturbance.any()  # from here on both states are of these inputs


def test_the_prediction_holds_what_the_controller_plans_from():
    f, x = Predictor(0.1), rest()
    x[:6] = 1.0, 2.0, 3.0, 0.5, -0.5, 0.2
    strong = np.array([GRAVITY + 2.0, 0.0, 0.0, 0.0])
    f.sent(0.9, HOVER)
    f.sent(1.0, strong)
    f.disturbance = np.array([0.4, 0.0, 0.0])
    told = f.update(vehicle(1.0, x))
    assert told.delay == 0.1
    assert told.u_last.tolist() == strong.tolist()
    assert told.disturbance.tolist() == [0.4, 0.0, 0.0]
    assert told.x0 == pytest.approx([1.052, 1.95, 3.02, 0.54, -0.5, 0.2, 1.0, 0.0, 0.0, 0.0])


def test_each_tick_observes_before_it_predicts():
    f, x = Predictor(DELAY), rest()
    f.sent(0.0, HOVER)
    f.update(vehicle(1.0, x))
    x = x.copy()
    x[3] = 0.05
    told = f.update(vehicle(1.1, x))
    assert told.disturbance == pytest.approx([0.05, 0.0, 0.0])
    assert told.x0[3] == pytest.approx(0.05 + 0.05 * DELAY)


def test_drag_slows_the_predicted_motion_along_the_ground_only():
    f, x = Predictor(0.05, drag=0.3), rest()
    x[3:6] = 2.0, -1.0, 1.0
    ahead = f.ahead(vehicle(0.0, x))
    assert ahead[3:6] == pytest.approx([2.0 - 0.6 * 0.05, -1.0 + 0.3 * 0.05, 1.0])


def test_drag_counts_anew_from_each_input_on():
    """Both inputs hover; 0.04 s by the first, then 0.06 s by the second."""
    f, x = Predictor(0.1, drag=0.5), rest()
    x[3] = 2.0
    f.sent(0.0, HOVER)
    f.sent(0.94, HOVER)
    first = 2.0 - 0.5 * 2.0 * 0.04
    ahead = f.ahead(vehicle(1.0, x))
    assert ahead[3] == pytest.approx(first - 0.5 * first * 0.06)
    assert ahead[0] == pytest.approx((2.0 + first) / 2 * 0.04 + (first + ahead[3]) / 2 * 0.06)


def test_a_past_state_is_carried_by_the_inputs_sent_since():
    f, x = Predictor(DELAY), rest()
    x[:6] = 1.0, 2.0, 3.0, 0.5, 0.0, 0.0
    f.sent(0.0, HOVER)
    f.sent(0.94, np.array([GRAVITY + 2.0, 0.0, 0.0, 0.3]))
    found = f.carried(vehicle(0.9, x), 1.05)  # the second acts from 1.0 s on
    assert found.time == 1.05
    assert found.p == pytest.approx([1.075, 2.0, 3.0 + 0.05**2])
    assert found.v == pytest.approx([0.5, 0.0, 0.1])
    assert found.q_wb == pytest.approx([np.cos(0.0075), 0.0, 0.0, np.sin(0.0075)])
    assert found.omega.tolist() == [0.0, 0.0, 0.3]


def watched(tilt=0.2, dt=0.1, ticks=2, faster=0.0, v=(0.0, 0.0, 0.0), drag=0.0):
    """Return the disturbance of a drone that leans to the east and moves as before.

    tilt: rad. faster: m/s², upward.
    """
    f, x = Predictor(DELAY, drag), rest()
    x[3:6] = v
    x[6:] = _turn(np.array([np.sin(tilt), 0.0, np.cos(tilt)]))
    for k in range(ticks):
        f.watch(vehicle(1.0 + dt * k, x))
        x = x.copy()
        x[5] += faster * dt
    return f.disturbance


def test_the_wind_holds_what_the_tilt_pushes_and_does_not_move():
    """A tenth of it by each tick; in a climb that grows, the thrust is larger."""
    assert watched() == pytest.approx([-0.1 * GRAVITY * np.tan(0.2), 0.0, 0.0])
    assert watched(faster=2.0) == pytest.approx([-0.1 * (GRAVITY + 2.0) * np.tan(0.2), 0.0, 0.0])


def test_a_drone_that_falls_faster_than_free_is_pushed_by_no_thrust():
    assert watched(faster=-12.0) == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(("cosine", "learnt"), [(0.81, True), (0.79, False)])
def test_a_drone_that_leans_by_more_than_37_degrees_tells_no_wind(cosine, learnt):
    assert watched(np.arccos(cosine)).any() == learnt


@pytest.mark.parametrize(("dt", "learnt"), [(0.24, True), (0.26, False), (-0.05, False)])
def test_states_far_apart_or_out_of_order_tell_no_wind(dt, learnt):
    assert watched(dt=dt).any() == learnt


def test_wind_is_what_drag_does_not_explain():
    """It keeps its speed and does not lean: a wind of the same speed carries it."""
    wind = watched(tilt=0.0, ticks=100, v=(2.0, -1.0, 1.0), drag=0.3)
    assert wind == pytest.approx([0.6, -0.3, 0.0], abs=1e-3)


def test_what_was_watched_is_compared_with_once_the_own_inputs_fly():
    f, x = Predictor(DELAY), rest()
    f.history.clear()
    f.watch(vehicle(1.0, x))
    f.sent(1.0, HOVER)
    x = x.copy()
    x[5] = 0.05
    f.observe(vehicle(1.1, x))
    assert f.disturbance == pytest.approx([0.0, 0.0, 0.05])


def test_no_drag_is_known_unless_it_is_told():
    f, x = StatePredictor(InputHistory(DELAY)), rest()
    x[3:6] = 2.0, -1.0, 1.0
    assert f.update(vehicle(0.0, x)).disturbance.tolist() == [0.0, 0.0, 0.0]


def test_a_watched_state_out_of_order_tells_nothing_of_the_wind():
    f, x = Predictor(DELAY), rest()
    f.watch(vehicle(1.0, x))
    x = x.copy()
    x[3] = 0.05
    f.watch(vehicle(0.95, x))
    assert not f.disturbance.any()
