"""A neighbour that circles for minutes, in and out of view: its covariance stays one."""

import numpy as np

from companion.estimation.tracker import Tracker, TrackerConfig
from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def test_a_covariance_stays_symmetric_and_positive():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(1)
    for k in range(1000):
        time = k / 10
        own = VehicleState(time, np.zeros(3), np.zeros(3), LEVEL, np.zeros(3))
        around = np.array([4.0 * np.cos(0.3 * time), 4.0 * np.sin(0.3 * time), 0.5])
        place = around + 0.02 * rng.standard_normal(3)
        away = float(np.linalg.norm(place))
        look = Detection(place / away, away, sigma_bearing=0.003, sigma_range=0.02 * away)
        tracker.update(time, [look] * (rng.random() > 0.3), own, LEVEL, None)
        tracker.predict(time + 0.02)
        for track in tracker.tracks():
            np.testing.assert_allclose(track.P, track.P.T, atol=1e-9)
            assert np.linalg.eigvalsh(track.P).min() > 0.0
