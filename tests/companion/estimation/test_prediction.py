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
