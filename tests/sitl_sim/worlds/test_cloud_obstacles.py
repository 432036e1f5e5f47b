"""Worlds from point clouds: files as Open3D 0.20 wrote them, and what points become."""

from pathlib import Path

import numpy as np
import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.worlds.cells import blocks
from sitl_sim.worlds.cloud_obstacles import circle, obstacles_of
from sitl_sim.worlds.point_cloud import read_points
from sitl_sim.worlds.world import WorldConfig, surface_distance

CLOUDS = Path(__file__).parent / "clouds"
K = np.arange(40.0)
WRITTEN = np.column_stack([0.25 * K - 5, 3 - 0.125 * K, 0.0625 * K])  # exact as float32, too
FILES = ("ascii.pcd", "binary.pcd", "compressed.pcd", "ascii.ply", "binary.ply")


@pytest.fixture
def rng():
    return np.random.default_rng(32)


def ground(rng, slope=0.0, half=8.0, n=40_000):
    x, y = rng.uniform(-half, half, (2, n))
    return np.column_stack([x, y, slope * x + rng.normal(0, 0.01, n)])


def trunk(rng, x, y, radius, top, arc=2 * np.pi, foot=0.0, n=1500, noise=0.01):
    angle, z = rng.uniform(0, arc, n), rng.uniform(0, top, n)
    r = radius + rng.normal(0, noise, n)
    return np.column_stack([x + r * np.cos(angle), y + r * np.sin(angle), foot + z])


def wall(rng, x, y0, y1, top, n=8000):
    y, z = rng.uniform(y0, y1, n), rng.uniform(0, top, n)
    return np.column_stack([x + rng.normal(0, 0.01, n), y, z])


def world(trunks, boxes):
    return {
        "cylinders": [c.model_dump() for c in trunks],
        "boxes": [b.model_dump() for b in boxes],
    }


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_library_is_read_to_the_bit(name):
    np.testing.assert_array_equal(read_points(CLOUDS / name), WRITTEN)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("kept", [0, 7, 60, 0.5, 0.9])
def test_a_file_that_is_cut_off_is_told_in_one_line(tmp_path, name, kept):
    whole = (CLOUDS / name).read_bytes()
    file = tmp_path / name
    file.write_bytes(whole[: kept if isinstance(kept, int) else int(kept * len(whole))])
    with pytest.raises(SettingsError) as told:
        read_points(file)
    assert str(told.value).startswith(f"world.obstacles: {file}: ")
    assert "cut off" in str(told.value)
    assert "\n" not in str(told.value)


def test_what_is_no_cloud_is_told(tmp_path):
    with pytest.raises(SettingsError, match=r"none.ply: cannot be read: No such file"):
        read_points(tmp_path / "none.ply")
    whole = (CLOUDS / "ascii.pcd").read_text()
    file = tmp_path / "flat.pcd"
    file.write_text(whole.replace("x y z", "x y intensity"))
    with pytest.raises(SettingsError, match=r"has no field z; fields: x, y, intensity, rgb"):
        read_points(file)
    far = tmp_path / "utm.pcd"
    far.write_text(whole.replace("-5 3 0", "691000.5 5334000 0"))
    with pytest.raises(SettingsError, match="points count up to 5334000 m: must be within 10000"):
        read_points(far)
    nothing = tmp_path / "nan.pcd"
    head = whole[: whole.index("DATA ascii")].replace("40", "1")
    nothing.write_text(head + "DATA ascii\nnan nan nan 0\n")
    with pytest.raises(SettingsError, match="holds no points"):
        read_points(nothing)


@pytest.mark.parametrize("arc", [2 * np.pi, 2.2])  # scanned from all sides, from one
@pytest.mark.parametrize("slope", [0.0, 0.17])
def test_trunks_are_found_where_they_stand(rng, arc, slope):
    made = [(2.0, 1.0, 0.15, 6.0), (-3.0, 2.5, 0.4, 3.0), (0.5, -4.0, 0.8, 7.5)]
    parts = [trunk(rng, *t, arc=arc, foot=slope * t[0]) for t in made]
    noise = rng.uniform((-8, -8, 0), (8, 8, 4), (40, 3))
    cloud = np.vstack([ground(rng, slope), noise, *parts])
    trunks, boxes = obstacles_of(cloud, WorldConfig())
    assert boxes == []
    found = sorted((c.x, c.y, c.radius, c.height) for c in trunks)
    for one, other in zip(found, sorted(made), strict=True):
        assert one[:3] == pytest.approx(other[:3], abs=0.03)
        # Of ground that rises by 0.17, cells of 1 m know the height to half of that.
        assert one[3] == pytest.approx(other[3], abs=0.1 + slope / 2)


def test_all_else_becomes_boxes_with_their_openings(rng):
    cloud = wall(rng, 3.05, -3, 3, 4.0)
    window = (np.abs(cloud[:, 1]) < 1.0) & (cloud[:, 2] > 1.0) & (cloud[:, 2] < 2.6)
    trunks, boxes = obstacles_of(np.vstack([ground(rng), cloud[~window]]), WorldConfig())
    assert trunks == []
    made = world(trunks, boxes)
    through = np.column_stack([np.full(5, 3.05), np.linspace(-0.7, 0.75, 5), np.full(5, 1.8)])
    assert (surface_distance(through, made) > 0.2).all()
    below = through * (1, 1, 0.25)  # 0.45 m: under the heights that count, and yet wall
    assert (surface_distance(below, made) < 0.0).all()
    for y in (-2.5, 2.5):
        assert surface_distance(np.array([3.05, y, 2.0]), made) < 0.0


def test_no_point_is_forgotten_and_no_room_is_filled(rng):
    """What stands within the heights lies in an obstacle or at its surface, and the reverse."""
    branch = rng.uniform((1.4, 1, 2), (2.9, 1.1, 2.1), (100, 3))
    bush = rng.normal((-4, -4, 1.0), (0.4, 0.4, 0.4), (3000, 3))
    lean = trunk(rng, 5, -5, 0.2, 5.0)
    lean[:, 0] += 0.3 * lean[:, 2]
    cloud = np.vstack([trunk(rng, 1, 1, 0.4, 6.0), branch, bush, lean, wall(rng, -6, 0, 5, 3.5)])
    config = WorldConfig(cloud_ground="zero")
    made = world(*obstacles_of(cloud, config))
    assert len(made["cylinders"]) == 1
    low, high = config.cloud_heights
    counts = cloud[(cloud[:, 2] >= low) & (cloud[:, 2] <= high)]
    away = surface_distance(counts, made)
    forgotten = counts[away > 0.1]
    assert len(forgotten) < 0.002 * len(counts)
    for p in forgotten:  # at the edge of the bush, where few points hang together
        assert (np.linalg.norm(counts - p, axis=1) < config.cloud_cell).sum() < 8
    corners = [np.array(b[k]) for b in made["boxes"] for k in ("min", "max")]
    reach = [np.linalg.norm((counts - c) * (1, 1, c[2] > 0), axis=1).min() for c in corners]
    assert max(reach) < config.cloud_cell * np.sqrt(3)


def test_a_square_pillar_and_a_floating_ball_are_no_trunks(rng):
    side, along, z = rng.integers(0, 4, 4000), rng.uniform(-0.3, 0.3, 4000), rng.uniform(0, 4, 4000)
    edge = np.where(side % 2, 0.3, -0.3)
    x, y = np.where(side < 2, edge, along), np.where(side < 2, along, edge)
    pillar = np.column_stack([x, y, z])
    ball = rng.normal(size=(1500, 3))
    ball = (4, 4, 2) + 0.4 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    trunks, boxes = obstacles_of(np.vstack([ground(rng), pillar, ball]), WorldConfig())
    assert trunks == []
    assert surface_distance(np.array([4.0, 4.0, 0.8]), world([], boxes)) > 0.5  # nothing below it


@pytest.mark.parametrize("towards", [(0, 0), (1, 0), (1, 0.3)])
def test_points_exactly_on_a_line_or_over_each_other_are_no_trunk(towards):
    along, up = np.meshgrid(np.linspace(0, 4, 80), np.linspace(0, 4, 40))
    sheet = np.stack([towards[0] * along, towards[1] * along, up], axis=-1).reshape(-1, 3)
    trunks, boxes = obstacles_of(sheet, WorldConfig(cloud_ground="zero"))
    assert trunks == []
    assert surface_distance(sheet[sheet[:, 2] > 0.5], world([], boxes)).max() < 1e-6


def test_what_cannot_be_flown_in_is_refused(rng):
    with pytest.raises(SettingsError, match=r"trees.ply: holds no points from 20 to 30 m above"):
        obstacles_of(ground(rng), WorldConfig(obstacles="trees.ply", cloud_heights=[20, 30]))
    leaves = rng.uniform((-8, -8, 0), (8, 8, 4), (200_000, 3))
    with pytest.raises(SettingsError, match=r"becomes \d+ boxes, more than 1000: crop it"):
        obstacles_of(leaves, WorldConfig(cloud_ground="zero"))
    far = np.array([[0.0, 0, 1], [9000, 9000, 1]])
    with pytest.raises(SettingsError, match=r"covers .* cells: crop it"):
        obstacles_of(far, WorldConfig(cloud_ground="zero"))


def test_a_circle_is_fitted_to_an_arc(rng):
    part = trunk(rng, 3, -2, 0.5, 1.0, arc=1.6, noise=0.005)
    assert circle(part[:, :2]) == pytest.approx((3, -2, 0.5), abs=0.02)
    line = np.column_stack([K, 2 * K])
    assert circle(line)[2] > 1e3


def test_blocks_hold_the_cells_and_no_other(rng):
    full = rng.random((9, 7, 5)) < 0.6
    again = np.zeros_like(full)
    for first, last in blocks(full):
        part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        assert not again[part].any()  # no two overlap
        again[part] = True
    np.testing.assert_array_equal(again, full)
    assert len(blocks(np.ones((4, 5, 6), bool))) == 1


def test_a_scenario_flies_in_a_cloud(rng, tmp_path):
    from pypcd4 import PointCloud

    cloud = np.vstack([ground(rng), trunk(rng, 2, 1, 0.3, 6.0), wall(rng, -6, 0, 2, 3.5)])
    file = tmp_path / "scan.pcd"
    PointCloud.from_xyz_points(cloud.astype(np.float32)).save(file)
    loaded = scenarios.load("forest", [f"world.obstacles={file}", "world.generator=empty"])
    assert len(loaded.world.cylinders) == 1
    assert loaded.world.boxes
    assert loaded.world.obstacles is None  # a run folder needs the file no longer
    with pytest.raises(SettingsError, match="cloud_heights: must rise, got 3, 1"):
        scenarios.load("forest", ["world.cloud_heights=[3, 1]"])
