"""Rendered pictures and depth against geometry."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from companion.perception.camera import Camera
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios.sensing import SensingConfig, lens_of
from sitl_sim.sensors.fisheye import R_BC, Lens, rotation
from sitl_sim.sensors.renderer import Renderer, Sensor
from sitl_sim.sensors.sensor import measured

LEVEL = np.array([1.0, 0, 0, 0])


NO_DRONES = (np.zeros((0, 3)), np.zeros((0, 4)))


WORLD = {
    "cylinders": [
        {"x": 5.0, "y": 1.0, "radius": 1.0, "height": 3.0},
        {"x": 9.0, "y": 1.5, "radius": 0.6, "height": 9.0},
        {"x": 4.0, "y": -3.0, "radius": 0.3, "height": 1.2},
        {"x": -6.0, "y": 0.5, "radius": 1.5, "height": 20.0},
    ],
    "boxes": [
        {"min": [6.0, -6.0, 0.0], "max": [7.0, -4.0, 4.0]},
        {"min": [2.0, 4.0, 1.0], "max": [3.0, 6.0, 2.5]},
    ],
    "drone_radius": 0.2,
}


@pytest.fixture(scope="module")
def renderer():
    return Renderer(WORLD, 320, 200, seed=3)


def slow_range(origin, ray):
    """Nearest surface along a unit ray, one shape after another, straight from geometry."""
    best = np.inf
    if ray[2] < 0:
        best = -origin[2] / ray[2]
    for c in WORLD["cylinders"]:
        f = origin[:2] - [c["x"], c["y"]]
        a, b = ray[:2] @ ray[:2], f @ ray[:2]
        root = b * b - a * (f @ f - c["radius"] ** 2)
        if root > 0:
            t = (-b - np.sqrt(root)) / a
            if t > 0 and 0 <= origin[2] + t * ray[2] <= c["height"]:
                best = min(best, t)
        if ray[2] != 0:
            t = (c["height"] - origin[2]) / ray[2]
            if t > 0 and np.hypot(*(f + t * ray[:2])) < c["radius"]:
                best = min(best, t)
    for box in WORLD["boxes"]:
        with np.errstate(divide="ignore"):
            t = (np.array([box["min"], box["max"]]) - origin) / ray
        t_in, t_out = t.min(axis=0).max(), t.max(axis=0).min()
        if 0 < t_in < t_out:
            best = min(best, t_in)
    return best


@pytest.mark.parametrize("seed", range(6))
def test_depth_equals_a_slow_ray_caster(renderer, seed):
    rng = np.random.default_rng(seed)
    p = np.array([*rng.uniform(-2, 1, 2), rng.uniform(0.5, 5)])
    q = rng.normal(size=4) * [1, 0.15, 0.15, 1]
    q /= np.linalg.norm(q)
    w, h, f = 48, 30, 48 / np.radians(160)
    depth = renderer.depth(p, q, *NO_DRONES, width=w, height=h)
    mx, my = np.meshgrid((np.arange(w) - (w - 1) / 2) / f, (np.arange(h) - (h - 1) / 2) / f)
    theta = np.hypot(mx, my)
    rays = np.stack([mx * np.sinc(theta / np.pi), my * np.sinc(theta / np.pi), np.cos(theta)], -1)
    rays = rays @ (rotation(q) @ R_BC).T
    expected = np.array([[slow_range(p, ray) for ray in row] for row in rays])
    near = np.isfinite(expected) & (expected < 30)
    # Outlines may fall into the neighbouring azimuth bin; surfaces may not.
    wrong = np.abs(depth[near] - expected[near]) > 0.02 * expected[near] + 0.01
    assert wrong.mean() < 0.02
    assert (np.isfinite(depth) != np.isfinite(expected)).mean() < 0.02


def scene(index):
    rng = np.random.default_rng(index)
    p = np.array([0.0, 0.0, 1.5])
    drones = p + rng.uniform([1, -2, -0.5], [6, 2, 0.5], (5, 3))
    return p, LEVEL, drones, np.tile(LEVEL, (5, 1)), index


def test_same_arguments_same_bytes_from_any_thread(renderer):
    alone = [renderer.render(*scene(i)) for i in range(12)]
    again = Renderer(WORLD, 320, 200, seed=3)
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda i: again.render(*scene(i)), range(12)))
    for a, b in zip(alone, together, strict=True):
        np.testing.assert_array_equal(a, b)


def test_noise_differs_from_frame_to_frame(renderer):
    p, q, *drones, _ = scene(0)
    a, b = renderer.render(p, q, *drones, 1), renderer.render(p, q, *drones, 2)
    assert 1.0 < np.abs(a.astype(int) - b).mean() < 6.0


def test_out_is_filled_and_returned(renderer):
    out = np.zeros((200, 320, 3), np.uint8)
    assert renderer.render(*scene(1), out) is out
    np.testing.assert_array_equal(out, renderer.render(*scene(1)))


def magenta(image):
    b, g, r = (image[..., i].astype(int) for i in range(3))
    return (np.minimum(b, r) - g) > 60


def test_a_drone_is_drawn_at_its_place_and_not_behind_a_trunk(renderer):
    p = np.array([0.0, 0.0, 1.5])
    for drone, shown in (([3.0, -1.0, 1.5], True), ([7.0, 1.4, 1.5], False), ([-3, 0, 1.5], False)):
        image = renderer.render(p, LEVEL, np.array([drone]), LEVEL[None])
        assert magenta(image).any() == shown
    v, u = np.nonzero(magenta(renderer.render(p, LEVEL, np.array([[3.0, -1.0, 1.5]]), LEVEL[None])))
    assert u.mean() == pytest.approx(159.5 + np.arctan2(1, 3) * 320 / np.radians(160), abs=0.5)
    assert v.mean() == pytest.approx(99.5, abs=0.5)


def test_the_camera_does_not_see_its_own_drone(renderer):
    p = np.array([0.0, 0.0, 1.5])
    own = renderer.render(p, LEVEL, p[None], LEVEL[None], 5)
    np.testing.assert_array_equal(own, renderer.render(p, LEVEL, *NO_DRONES, 5))


def test_depth_sees_drones(renderer):
    p = np.array([0.0, 0.0, 1.5])
    depth = renderer.depth(p, LEVEL, np.array([[3.0, 0.0, 1.5]]), LEVEL[None], 161, 101)
    assert depth[50, 80] == pytest.approx(2.9, abs=0.02)


def test_sky_is_above_and_ground_below():
    r = Renderer({"cylinders": [], "boxes": []}, 320, 200, sensor=Sensor(noise=0.0))
    image = r.render(np.array([0.0, 0.0, 2.0]), LEVEL, *NO_DRONES).astype(float)
    top, bottom = image[10].mean(axis=0), image[190].mean(axis=0)
    assert top[0] > top[2]  # blue
    assert bottom[2] > bottom[0]  # brown


def test_ground_that_slopes_is_as_far_as_its_plane_and_shows_above_the_horizon_uphill():
    rise = np.tan(np.radians(10.0))
    axis = [-60.0, 60.0]
    terrain = {
        "x": axis,
        "y": axis,
        "z": [[rise * x for x in axis] for _ in axis],
    }  # up to the east
    r = Renderer({"cylinders": [], "boxes": [], "terrain": terrain}, sensor=Sensor(noise=0.0))
    p = np.array([4.0, -3.0, 4.0 * rise + 2.0])
    rays = r.lens.rays.transpose(1, 2, 0)[::20, ::20] @ R_BC.T  # level, looking east, uphill
    falls = rays[..., 2] - rise * rays[..., 0]
    with np.errstate(divide="ignore"):
        expected = np.where(falls < 0, -2.0 / falls, np.inf)
    depth = r.depth(p, LEVEL, *NO_DRONES, r.lens.width, r.lens.height)[::20, ::20]
    np.testing.assert_allclose(depth, expected, rtol=1e-3)
    image = r.render(p, LEVEL, *NO_DRONES).astype(float)
    row, column = (int(v) for v in r.lens.project(np.array([[0.0, -0.1, 1.0]]))[0][::-1])
    assert image[row, column, 2] > image[row, column, 0]  # 6° above the horizon: ground, brown
    below = np.array([4.0, -3.0, 0.0])  # a camera under the ground sees as from just above it
    assert np.isfinite(r.depth(below, LEVEL, *NO_DRONES)).any()


def test_exposure_and_blur_have_their_effect():
    sensors = (Sensor(noise=0), Sensor(noise=0, exposure=0.4), Sensor(noise=0, blur=1.5))
    plain, dark, soft = (
        Renderer(WORLD, 320, 200, seed=3, sensor=s).render(*scene(2)).astype(float) for s in sensors
    )
    assert dark.mean() == pytest.approx(0.4 * plain.mean(), rel=0.05)
    assert np.abs(np.diff(soft, axis=1)).mean() < 0.7 * np.abs(np.diff(plain, axis=1)).mean()


def test_a_calibrated_lens_draws_a_drone_where_the_companions_camera_projects_it(tmp_path):
    lens = Camera(320, 200, 118.0, 116.0, 161.0, 97.5, np.array([-0.02, 0.004, -0.001, 0.0]))
    lens.save(tmp_path / "camera.yaml")  # each end reads the file for itself
    r = Renderer({"cylinders": [], "boxes": []}, lens=Lens.load(tmp_path / "camera.yaml"))
    p = np.array([0.0, 0.0, 2.0])
    for place in ([3.0, 0.0, 2.0], [1.5, 2.6, 2.3], [1.0, -2.2, 1.8]):
        image = r.render(p, LEVEL, np.array([place]), LEVEL[None])
        v, u = np.nonzero(magenta(image))
        x, y, z = np.array(place) - p
        ((eu, ev),) = lens.project(np.array([[-y, -z, x]]))
        assert u.mean() == pytest.approx(eu, abs=0.6)
        assert v.mean() == pytest.approx(ev, abs=0.6)
    rays = Lens.load(tmp_path / "camera.yaml").rays.transpose(1, 2, 0)
    np.testing.assert_allclose(rays, lens.directions, atol=2e-4)


def test_a_depth_sensor_is_noisy_and_ends_at_its_range(renderer):
    p = np.array([0.0, 0.0, 1.5])
    true = renderer.depth(p, LEVEL, *NO_DRONES)
    got = measured(true, 8.0, 0.01, seed=5)
    np.testing.assert_array_equal(got, measured(true, 8.0, 0.01, seed=5))
    near = true < 7.0
    assert np.std(got[near] / true[near] - 1) == pytest.approx(0.01, rel=0.1)
    assert np.isinf(got[true > 9.0]).all()


def test_an_unusable_calibration_is_an_error(tmp_path):
    with pytest.raises(SettingsError, match=r"none\.yaml"):
        lens_of(SensingConfig(calibration=str(tmp_path / "none.yaml")))
    Camera.equidistant(320, 200).save(tmp_path / "camera.yaml")
    with pytest.raises(SettingsError, match="made at 320×200"):
        lens_of(SensingConfig(calibration=str(tmp_path / "camera.yaml")))
    flat = (tmp_path / "camera.yaml").read_text().replace("fx: ", "fx: 0.0 # ")
    (tmp_path / "camera.yaml").write_text(flat)
    with pytest.raises(SettingsError, match=r"camera\.yaml: .* fx, fy must be positive"):
        lens_of(SensingConfig(calibration=str(tmp_path / "camera.yaml")))
