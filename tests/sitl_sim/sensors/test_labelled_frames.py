import json

import cv2
import numpy as np

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_frames import CONDITIONS, label, looks, rendered
from sitl_sim.sensors.scenes import crowded_scenes, flight_scenes, still_scenes, visible_shares
from sitl_sim.worlds.world import Occluders

LENS = Lens(640, 400)


def test_the_same_seed_gives_the_same_scenes():
    a, b = list(still_scenes(5, 3, LENS)), list(still_scenes(5, 3, LENS))
    for one, two in zip(a, b, strict=True):
        assert json.dumps(label(one, LENS)) == json.dumps(label(two, LENS))
    assert json.dumps(label(next(still_scenes(1, 4, LENS)), LENS)) != json.dumps(label(a[0], LENS))


def test_a_label_says_where_the_picture_shows_a_drone():
    scene, image = next(
        rendered(crowded_scenes(1, 1, 5, LENS), CONDITIONS["clean"], "marked", LENS, 5, 1)
    )
    b, g, r = (image[..., n].astype(int) for n in range(3))
    v, u = np.nonzero(np.minimum(b, r) - g > 60)
    x, y, z = label(scene, LENS)["drones"][0]["direction"]
    theta = np.arccos(z) / np.hypot(x, y)
    assert abs(u.mean() - (319.5 + LENS.f * theta * x)) < 1.0
    assert abs(v.mean() - (199.5 + LENS.f * theta * y)) < 1.0


def test_visible_is_the_share_that_nothing_hides():
    trunk = {"cylinders": [{"x": 3.0, "y": 0.0, "radius": 0.5, "height": 9.0}]}
    p, q = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0, 0, 0])
    half = 6.0 * np.tan(np.arcsin(0.5 / 3.0))  # where the trunk's edge ends, 6 m away
    places = np.array([[6.0, 0, 2], [6.0, half, 2], [6.0, 2 * half, 2], [-6.0, 0, 2]])
    shares = visible_shares(p, q, places, Occluders(trunk), LENS)
    assert shares[0] == 0.0
    assert 0.3 < shares[1] < 0.7
    assert shares[2] == 1.0
    assert shares[3] == 0.0


def test_flights_are_smooth_and_free_of_trunks():
    (flight,) = flight_scenes(1, 2.0, 6, LENS)
    p = np.array([s.p for s in flight])
    v = np.array([s.own_v for s in flight])
    np.testing.assert_allclose(np.diff(p, axis=0), 0.1 * v[1:], atol=1e-9)
    for c in flight[0].world["cylinders"]:
        assert (np.hypot(p[:, 0] - c["x"], p[:, 1] - c["y"]) > c["radius"] + 0.35).all()


def test_looks_and_weather_are_what_they_say():
    rng = np.random.default_rng(2)
    assert all(look.marker_radius > 0 for look in looks("marked", rng))
    assert all(look.marker_radius == 0 for look in looks("bare", rng) + looks("tree", rng))
    scene = next(crowded_scenes(1, 1, 5, LENS))
    plain = np.full((400, 640, 3), 120, np.uint8)
    sunny = CONDITIONS["backlight"].after(plain, scene, LENS, rng)
    assert sunny.max() == 255
    assert np.median(sunny) < 120
    rain = CONDITIONS["rain"].after(plain, scene, LENS, rng)
    assert cv2.Laplacian(rain, cv2.CV_32F).std() > 1.0
