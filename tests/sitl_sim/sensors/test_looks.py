"""Looks of worlds and drones: names, determinism, and truth against geometry."""

import hashlib
import itertools
import json

import numpy as np
import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.__main__ import main
from sitl_sim.scenarios.scenario import read
from sitl_sim.sensors.drones import Look
from sitl_sim.sensors.fisheye import R_BC, Lens, rotation
from sitl_sim.sensors.labelled_pictures import drawn_bodies, stream
from sitl_sim.sensors.look_frames import write_looks
from sitl_sim.sensors.looks import bodies, look
from sitl_sim.sensors.looks.catalogue import names, readable
from sitl_sim.sensors.looks.renderer import LookRenderer
from sitl_sim.sensors.looks.shapes import Seen
from sitl_sim.sensors.renderer import Renderer
from sitl_sim.sensors.renderers import flown_bodies, make_renderer
from sitl_sim.sensors.scenes import still_scenes, trunks_in_view, varied_scenes
from sitl_sim.worlds.world import surface_distance

LEVEL = np.array([1.0, 0, 0, 0])
NO_DRONES = (np.zeros((0, 3)), np.zeros((0, 4)))
SMALL = Lens(160, 100)
GENTLE = np.linspace(-30, 30, 31)
WORLD = {
    "cylinders": [{"x": 5.0, "y": 1.0, "radius": 1.0, "height": 3.0}],
    "capsules": [
        {"a": [4.0, -3.0, 0.0], "b": [4.5, -4.0, 8.0], "radius": 0.3},
        {"a": [3.0, 2.0, 1.0], "b": [3.5, 4.0, 2.2], "radius": 0.1, "kind": "branch"},
    ],
    "spheres": [{"centre": [-4.0, 1.0, 0.5], "radius": 0.9}],
    "boxes": [{"min": [-6.0, -6.0, 0.0], "max": [-4.0, -4.0, 4.0]}],
    "drone_radius": 0.2,
}
SLOPE = {
    "x": GENTLE.tolist(),
    "y": GENTLE.tolist(),
    "z": (0.15 * GENTLE[None] + 0.4 * np.sin(GENTLE / 6)[:, None]).tolist(),
}


@pytest.fixture(scope="module")
def renderer():
    return LookRenderer(WORLD, "litter", SMALL, 3)


def test_plain_frames_are_the_bytes_that_they_were_before_there_were_looks():
    digest = hashlib.sha256()
    scenes = list(still_scenes(4, 7, Lens(320, 200), varied=True))
    plain = make_renderer(scenes[0].world, "plain", "ball", 7, Lens(320, 200))
    assert isinstance(plain, Renderer)
    for k, s in enumerate(scenes):
        digest.update(plain.render(s.p, s.q, s.drones, s.attitudes, k).tobytes())
        digest.update(plain.depth(s.p, s.q, s.drones, s.attitudes).tobytes())
    assert digest.hexdigest() == "c7df72c986bbf59dfe3a4937de888de48c6469c14b164417afc17a03e041a2e5"


@pytest.mark.parametrize("name", names()[1:])
def test_every_look_renders_the_same_bytes_again(name):
    made = [
        LookRenderer(WORLD, name, SMALL, 5).render(np.array([0, 0, 1.5]), LEVEL, *NO_DRONES, 9)
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*made)
    spread = float(made[0].astype(float).std())
    if name in readable():
        assert spread > 8.0
    elif name != "random":
        # Nothing is left to see but noise, or the sun: neighbouring regions do not differ.
        regions = made[0].astype(float).reshape(10, 10, 10, 16, 3).mean(axis=(1, 3))
        assert np.abs(np.diff(regions[5:8], axis=1)).mean() < 12.0


def test_there_are_twelve_looks_and_they_differ():
    assert len(readable()) >= 12
    at = (np.array([0.0, 0, 1.5]), LEVEL, *NO_DRONES)
    means = [
        LookRenderer(WORLD, name, SMALL, 1).render(*at).mean(axis=(0, 1)) for name in readable()
    ]
    apart = np.linalg.norm(np.array(means)[:, None] - means, axis=-1)
    assert np.median(apart) > 25.0  # grey levels


def nearest(p, ray, world, height):
    """March along a ray to the nearest surface of a world over the ground `height(x, y)`."""
    t = 0.0
    while t < 25.0:
        at = p + t * ray
        gap = min(float(surface_distance(at, world)), 0.8 * (at[2] - height(at[0], at[1])))
        if gap < 1e-3:
            return t
        t += gap
    return np.inf


@pytest.mark.parametrize("uneven", [False, True])
def test_depth_equals_a_march_through_the_world_that_the_judge_sees(uneven):
    world = {k: v for k, v in WORLD.items() if k != "spheres"}
    height = lambda x, y: 0.0  # noqa: E731
    if uneven:
        world["terrain"] = SLOPE
        height = lambda x, y: 0.15 * x + 0.4 * np.sin(y / 6)  # noqa: E731
    r = LookRenderer(world, "litter", SMALL, 3)
    rng = np.random.default_rng(2)
    wrong = total = 0
    for _ in range(3):
        p = np.array([0.0, 0.0, rng.uniform(1.0, 2.5)])
        q = rng.normal(size=4) * [1, 0.1, 0.1, 1]
        q /= np.linalg.norm(q)
        depth = r.picture(p, q, *NO_DRONES).depth
        rays = SMALL.rays.transpose(1, 2, 0).astype(float) @ (rotation(q) @ R_BC).T
        for v, u in rng.integers(0, [100, 160], (150, 2)):
            true = nearest(p, rays[v, u], world, height)
            if true < 12.0:
                total += 1
                wrong += abs(depth[v, u] - true) > 0.03 * true + 0.02
    assert total > 150
    assert wrong <= 0.01 * total


def test_bushes_are_where_the_judge_sees_them(renderer):
    picture = renderer.picture(np.array([0.0, 0, 1.0]), np.array([0.0, 0, 0, 1]), *NO_DRONES)
    bush = picture.seen == Seen.BUSH
    assert bush.sum() > 100
    rays = SMALL.rays.transpose(1, 2, 0) @ (rotation(np.array([0.0, 0, 0, 1])) @ R_BC).T
    at = np.array([0.0, 0, 1.0]) + picture.depth[bush][:, None] * rays[bush]
    assert np.abs(np.linalg.norm(at - [-4.0, 1.0, 0.5], axis=1) - 0.9).max() < 0.02


def test_labels_of_trunks_agree_with_the_depth_of_the_picture():
    checked = 0
    for scene in varied_scenes(25, 12, SMALL, tilt_deg=5.0):
        trunks = trunks_in_view(scene, SMALL)
        depth = LookRenderer(scene.world, "sand", SMALL, 1).picture(scene.p, scene.q, *NO_DRONES)
        for level, distance, radius, share in trunks:
            if share < 1.0 or distance > 12.0:
                continue
            at = np.argmax(np.tensordot(level, SMALL.rays, 1))
            v, u = np.unravel_index(at, depth.depth.shape)
            if depth.seen[v, u] not in (Seen.TRUNK, Seen.THING):
                continue  # a bush's gap, a branch before the trunk
            assert depth.depth[v, u] == pytest.approx(distance - radius, rel=0.06, abs=0.08)
            checked += 1
    assert checked > 15


def test_a_stream_gives_the_same_pictures_and_labels_that_agree_with_them():
    first, again = (
        list(itertools.islice(stream(3, lens=Lens(320, 200), reach=5.0), 6)) for _ in range(2)
    )
    found = 0
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.depth, b.depth)
        for k, (u, v) in enumerate(a.pixel):
            vs, us = np.nonzero(a.owner == k)
            if a.visible[k] > 0.9 and len(us) > 12 and a.area[k] > 12:
                assert np.hypot(us.mean() - u, vs.mean() - v) < 0.7 * a.size[k] + 1.5
                assert np.hypot(us - u, vs - v).max() < 1.7 * a.size[k] + 2.0
                found += 1
        assert a.depth.dtype == np.float16
        assert np.isinf(a.depth[a.seen == Seen.SKY]).all()
        assert np.isfinite(a.depth[a.seen == Seen.TRUNK]).all()
    assert found > 3


def test_a_hidden_drone_shows_nothing(renderer):
    p = np.array([0.0, 0.0, 1.5])
    for place, share in (([2.5, -0.5, 1.5], 1.0), ([8.0, 1.6, 1.5], 0.0)):
        shown = renderer.picture(p, LEVEL, np.array([place]), LEVEL[None]).shown[0]
        assert shown[0] > 1
        assert shown[1] / shown[0] == pytest.approx(share, abs=0.02)


def test_turning_smears_the_picture(renderer):
    at = (np.array([0.0, 0, 1.5]), LEVEL, *NO_DRONES, 1)
    still = renderer.render(*at).astype(float)
    turning = renderer.render(*at, omega=np.array([0, 0, 40.0])).astype(float)
    across = [np.abs(np.diff(image, axis=1)).mean() for image in (still, turning)]
    assert across[1] < 0.8 * across[0]


@pytest.mark.parametrize("kind", bodies.KINDS)
def test_a_body_reaches_to_its_radius(kind):
    body = bodies.draw(kind, 0.15, np.random.default_rng(1))
    parts = body.parts()
    reach = []
    for part in parts:
        axes = np.linalg.inv(part[:9].reshape(3, 3))
        along = part[9:11] / max(np.hypot(*part[9:11]), 1e-9)
        reach.append(np.hypot(*part[9:11]) + np.linalg.norm(along @ axes[:2]))
    assert 0.85 * 0.15 < max(reach) < 1.12 * 0.15


def test_flown_bodies_are_of_one_kind_or_mixed():
    world = {"drone_radius": 0.2}
    bare, mixed = (flown_bodies(world, drones, 4) for drones in ("bare", "mixed"))
    assert len({b.kind for b in bare}) == 1
    assert {b.kind for b in mixed} == set(bodies.KINDS)
    assert isinstance(flown_bodies(world, "ball", 4)[0], Look)


def test_unknown_names_are_errors_that_list_the_choices(tmp_path):
    with pytest.raises(
        SettingsError, match=r"world\.look: no look 'swamp'; valid: plain, clearing"
    ):
        read("forest", ["world.look=swamp"])
    with pytest.raises(SettingsError, match=r"drones\.look"):
        read("forest", ["world.look=plain"])  # it knows balls only
    with pytest.raises(SettingsError, match=r"--look: no 'swamp'; valid: all, clearing"):
        write_looks(tmp_path, 0, 1, "swamp", "all")
    with pytest.raises(SettingsError, match=r"--bodies: no 'kite'; valid: all, quad-x"):
        write_looks(tmp_path, 0, 1, "sand", "kite")
    with pytest.raises(SettingsError, match="no look 'plain' to draw"):
        look.draw("plain", 0)
    with pytest.raises(ValueError, match="no drones 'kite'"):
        drawn_bodies("kite", np.random.default_rng(0))
    read("forest", ["world.look=random", "drones.look=mixed"])


def test_frames_of_open_ground_show_few_obstacles(tmp_path):
    def shown(name, *flags):
        folder = tmp_path / name
        look_of = ["--look", "sand", "--bodies", "bare", "--count", "5", "--seed", "4"]
        assert main(["frames", str(folder), *look_of, *flags]) == 0
        frames = json.loads((folder / "frames.json").read_text())["frames"]
        return sum(len(frame["trunks"]) for frame in frames)

    assert shown("open", "--open-ground") < 0.3 * shown("wood")
