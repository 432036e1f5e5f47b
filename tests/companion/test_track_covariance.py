"""A neighbour in view for minutes: its covariance stays one."""

import numpy as np

from companion.track import Tracker, TrackerConfig
from companion.types import Detection
from mavlink_bridge.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def test_a_covariance_stays_symmetric_and_positive():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(1)
    for k in range(3000):
        own = VehicleState(k / 10, np.zeros(3), np.zeros(3), LEVEL, np.zeros(3))
        place = np.array([4.0, 1.0, 0.5]) + 0.05 * rng.standard_normal(3)
        away = float(np.linalg.norm(place))
        seen = Detection(place / away, away, sigma_bearing=0.003, sigma_range=0.05 * away)
        tracker.update(k / 10, [seen], own, LEVEL, None)
        tracker.predict(k / 10 + 0.02)
    (track,) = tracker.tracks()
    np.testing.assert_allclose(track.P, track.P.T, atol=1e-9)
    assert np.linalg.eigvalsh(track.P).min() > 0.0
