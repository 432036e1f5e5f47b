"""Leaning trunks, branches and bushes: distances, lines of sight, generators."""

import numpy as np

from sitl_sim.worlds.generators import build
from sitl_sim.worlds.varied import MOST_LEAN, varied
from sitl_sim.worlds.world import Occluders, WorldConfig, surface_distance

WORLD = {
    "cylinders": [],
    "boxes": [],
    "capsules": [{"a": [4.0, -1.0, 0.0], "b": [5.0, 1.0, 6.0], "radius": 0.4}],
    "spheres": [{"centre": [-3.0, 0.0, 1.0], "radius": 0.8}],
}


def test_a_line_of_sight_is_free_exactly_where_no_point_of_it_is_inside_a_shape():
    rng = np.random.default_rng(1)
    start, ends = np.array([0.0, 0.0, 1.5]), rng.uniform([-7, -4, 0], [9, 4, 6], (1500, 3))
    along = np.linspace(0, 1, 400)[:, None, None]
    deepest = surface_distance(start + along * (ends - start), WORLD).min(axis=0)
    free = Occluders(WORLD).free(start, ends)
    clear = np.abs(deepest) > 0.01
    np.testing.assert_array_equal(free[clear], deepest[clear] > 0)
    assert 50 < (~free).sum() < 1450


def test_distance_to_round_shapes():
    at = np.array([[-3.0, 0.0, 3.0], [-3.0, 0.0, 1.2], [4.5, 0.0, 3.0]])
    np.testing.assert_allclose(surface_distance(at, WORLD), [1.2, -0.6, -0.4], atol=1e-9)


def test_a_forest_leans_and_has_bushes_by_its_seed():
    config = WorldConfig(generator="forest", lean_deg=12.0, branches=1.0, bushes=9)
    world = build(config, 3)
    assert world == build(config, 3)
    trunks = [c for c in world["capsules"] if "kind" not in c]
    axes = np.array([np.subtract(c["b"], c["a"]) for c in trunks])
    lean = np.degrees(np.arccos(axes[:, 2] / np.linalg.norm(axes, axis=1)))
    assert len(trunks) + len(world["cylinders"]) == 49
    assert 8.0 < lean.max() < 12.01
    assert any(c.get("kind") == "branch" for c in world["capsules"])
    assert len(world["spheres"]) >= 9
    assert set(build(WorldConfig(generator="forest"), 3)) == {"cylinders", "boxes"}


def test_varied_worlds_have_every_kind_of_obstacle_and_slope():
    worlds = [varied(np.random.default_rng(seed)) for seed in range(30)]
    radii = [c["radius"] for w in worlds for c in w["cylinders"] if "kind" not in c]
    assert min(radii) < 0.15
    assert max(radii) > 1.2
    kinds = {c.get("kind") for w in worlds for c in [*w["capsules"], *w["cylinders"]]}
    assert kinds == {None, "branch", "person", "pole"}
    assert any(w["spheres"] for w in worlds)
    assert any(w["boxes"] for w in worlds)
    assert 5 < sum("terrain" in w for w in worlds) < 20
    for w in worlds:
        for c in w["capsules"]:
            if "kind" not in c:
                axis = np.subtract(c["b"], c["a"])
                assert axis[2] / np.linalg.norm(axis) > np.cos(np.radians(MOST_LEAN + 0.1))


def test_open_ground_has_few_trunks():
    def trunks(world):
        shapes = [*world["cylinders"], *world["capsules"]]
        return sum("kind" not in shape for shape in shapes)

    counts = [trunks(varied(np.random.default_rng(k), open_ground=1.0)) for k in range(30)]
    assert min(counts) == 0
    assert max(counts) == 5
    assert min(trunks(varied(np.random.default_rng(k))) for k in range(30)) >= 10
