"""Seeded scenes: visible shares, and sequences that are smooth."""

import numpy as np

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.scenes import flight_scenes, visible_shares
from sitl_sim.worlds.world import Occluders

LENS = Lens(640, 400)


def test_the_visible_share_is_the_part_that_is_not_hidden():
    trunk = {"cylinders": [{"x": 3.0, "y": 0.0, "radius": 0.5, "height": 9.0}]}
    p, q = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0, 0, 0])
    half = 6.0 * np.tan(np.arcsin(0.5 / 3.0))  # where the trunk's edge ends, 6 m away
    places = np.array([[6.0, 0, 2], [6.0, half, 2], [6.0, 2 * half, 2], [-6.0, 0, 2]])
    shares = visible_shares(p, q, places, Occluders(trunk), LENS)
    assert shares[0] == 0.0
    assert 0.3 < shares[1] < 0.7
    assert shares[2] == 1.0
    assert shares[3] == 0.0


def test_sequences_are_smooth_and_free_of_trunks():
    (flight,) = flight_scenes(1, 2.0, 6, LENS)
    p = np.array([s.p for s in flight])
    v = np.array([s.own_v for s in flight])
    np.testing.assert_allclose(np.diff(p, axis=0), 0.1 * v[1:], atol=1e-9)
    for c in flight[0].world["cylinders"]:
        assert (np.hypot(p[:, 0] - c["x"], p[:, 1] - c["y"]) > c["radius"] + 0.35).all()
