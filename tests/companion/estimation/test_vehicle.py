"""The whole estimate of a vehicle: what its parts find reaches the state."""

import numpy as np
import pytest

from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import StatePredictor
from companion.estimation.vehicle import VehicleEstimate, VehicleEstimator
from companion.perception.camera_health import CameraFault
from companion.perception.ground_flow import GroundFlow
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import Attitude, DistanceSensor, LocalPosition, Received, Source

LEVEL, V, DOWN = np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 25


@pytest.mark.parametrize("sees_ground", [True, False])
def test_a_step_of_the_told_velocity_does_not_reach_the_state_where_ground_was_seen(sees_ground):
    """It flies on at 1 m/s; from 8 s on 0.4 m/s more are told."""
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    predictor, errors, at = StatePredictor(InputHistory(0.06)), {}, Source(1, 1)
    for k in range(1, 101):
        heard = []
        for t in (0.1 * k - 0.02 * j for j in range(4, -1, -1)):
            p = V * t + [0.0, 0.0, 2.0]
            told = np.array([1.0, 0.4 * (t > 7.99), 0.0])
            heard += [Attitude(t, LEVEL, np.zeros(3)), LocalPosition(t, p, told)]
        heard.append(DistanceSensor(0.1 * k, 2.0, 0.1, 12.0, DOWN))
        received = [Received(at, m) for m in heard]
        found = vehicle.update(0.1 * k, received, predictor, Phase.FLY)
        errors[k] = found.state.v - V
        if sees_ground and k > 1:
            flow = GroundFlow(0.1 * (k - 1), 0.1 * k, 0.1 * V[:2], 2.0)
            vehicle.see_flow(flow, CameraFault.NONE)
    assert np.linalg.norm(errors[79]) < 0.05
    assert not sees_ground or np.linalg.norm(errors[80]) < 0.01  # at once
    # The flow over the step itself shows half of it; then the ground settles what is left.
    worst = max(np.linalg.norm(errors[k]) for k in range(80, 101))
    assert worst < 0.2 if sees_ground else worst > 0.35


def test_before_a_state_is_told_there_is_none():
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    found = vehicle.update(0.1, [], StatePredictor(InputHistory(0.06)), Phase.PASSIVE)
    assert found.state is None
    assert found.height is None


@pytest.mark.parametrize("phase", [Phase.FLY, Phase.PASSIVE])
def test_a_late_state_is_carried_on_by_the_model_in_flight_alone(phase):
    """At 0.5 s nothing was heard for 0.3 s; the last input pitched the drone down."""
    history = InputHistory(0.06)
    predictor, at = StatePredictor(history), Source(1, 1)
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    for k in range(1, 6):
        t, p = 0.1 * k, V * 0.1 * k + [0.0, 0.0, 2.0]
        heard = [Attitude(t, LEVEL, np.zeros(3)), LocalPosition(t, p, V)] if k < 3 else []
        found = vehicle.update(t, [Received(at, m) for m in heard], predictor, phase)
        history.add(SentInput(t, np.array([GRAVITY, 0.0, 2.0, 0.0]), 0.3))
    carried = abs(found.state.q_wb[2]) > 0.05
    assert carried == (phase is Phase.FLY)


def test_without_news_an_estimate_grows_old_and_tells_nothing_new():
    told = VehicleEstimate(age=0.1, rebooted=True, mode_known=True, turned=0.1)
    later = told.without_news(0.2)
    assert later.age == pytest.approx(0.3)
    assert later.tick_gap == 0.2
    assert later.rebooted is False
    assert later.turned == 0.0
    assert (later.refusals, later.attitudes, later.turns) == ((), (), ())
