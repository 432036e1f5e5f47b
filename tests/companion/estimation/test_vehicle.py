"""The whole estimate of a vehicle: what its parts find reaches the state."""

import numpy as np
import pytest

from companion.estimation.input_history import InputHistory
from companion.estimation.prediction import StatePredictor
from companion.estimation.vehicle import VehicleEstimator
from companion.perception.camera_health import CameraFault
from companion.perception.ground_flow import GroundFlow
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Identity
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
