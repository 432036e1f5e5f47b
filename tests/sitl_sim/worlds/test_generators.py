"""Generated worlds have the shapes, densities and gaps of their parameters."""

import numpy as np
import pytest

from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.world import surface_distance


def test_the_tunnel_is_free_inside_and_closed_around():
    for seed in range(5):
        world = build(scenarios.load("tunnel", []).world, seed)
        length = max(b["max"][1] for b in world["boxes"])
        assert 1.0 <= length <= 2.0
        axis = np.array([[0.0, y, 2.0] for y in np.linspace(-length, length, 9)])
        assert surface_distance(axis, world) == pytest.approx(1.0)
        for blocked in ([1.5, 0, 2], [-1.5, 0, 2], [0, 0, 0.5], [0, 0, 3.5], [10, 0, 7]):
            assert surface_distance(np.array([blocked], float), world)[0] < 0


def test_a_thicket_has_its_density_and_its_gaps():
    config = scenarios.load("dense-forest", []).world
    x0, y0, x1, y1 = config.area
    for seed in range(5):
        trunks = build(config, seed)["cylinders"]
        assert len(trunks) / ((x1 - x0) * (y1 - y0)) == pytest.approx(0.1, rel=0.05)
        assert all(0.2 <= t["radius"] <= 0.5 for t in trunks)
        p, r = np.array([[t["x"], t["y"]] for t in trunks]), np.array([t["radius"] for t in trunks])
        room = np.linalg.norm(p[:, None] - p[None], axis=-1) - r[:, None] - r[None]
        assert (room + 1e3 * np.eye(len(p))).min() >= config.gap - 2e-4


def test_pillars_leave_gaps_of_five_metres():
    s = scenarios.load("pillars", ["world.jitter=0"])
    row = sorted(t["x"] for t in build(s.world, 0)["cylinders"] if abs(t["y"]) < 0.1)
    assert np.diff(row) - 2 * s.world.radius == pytest.approx(5.0)
