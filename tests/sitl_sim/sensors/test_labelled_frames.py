"""Labels agree with the rendered pictures."""

import json

import cv2
import numpy as np

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_frames import CONDITIONS, label, looks, rendered
from sitl_sim.sensors.scenes import crowded_scenes, still_scenes

LENS = Lens(640, 400)


def test_the_same_seed_gives_the_same_labels():
    a, b = list(still_scenes(5, 3, LENS)), list(still_scenes(5, 3, LENS))
    for one, two in zip(a, b, strict=True):
        assert json.dumps(label(one, LENS)) == json.dumps(label(two, LENS))
    assert json.dumps(label(next(still_scenes(1, 4, LENS)), LENS)) != json.dumps(label(a[0], LENS))


def test_a_label_has_the_place_of_the_drone_in_the_picture():
    scene, image = next(
        rendered(crowded_scenes(1, 1, 5, LENS), CONDITIONS["clean"], "marked", LENS, 5, 1)
    )
    b, g, r = (image[..., n].astype(int) for n in range(3))
    v, u = np.nonzero(np.minimum(b, r) - g > 60)
    x, y, z = label(scene, LENS)["drones"][0]["direction"]
    theta = np.arccos(z) / np.hypot(x, y)
    assert abs(u.mean() - (319.5 + LENS.f * theta * x)) < 1.0
    assert abs(v.mean() - (199.5 + LENS.f * theta * y)) < 1.0


def test_looks_and_weather_have_their_effect():
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
