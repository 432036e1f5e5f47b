"""Safety from a made-up truth of two drones whose figures are known by construction."""

import numpy as np
import pytest

from sitl_sim.metrics import safety

DT = 0.02
TRUNK = {"x": 4.0, "y": -1.0, "radius": 0.5, "height": 8.0}


def truth(gap, stops):
    """drone1 flies 10 m at 1 m/s, standing still for `stops` [s] at 2 m; drone2 beside it."""
    t = np.arange(0.0, 10.0 + sum(stops) + 4.0, DT)
    way, x, until = [], 0.0, 0.0
    pauses = {2.0 + k: s for k, s in enumerate(stops)}
    for now in t:
        if now >= until:
            x += DT
            for place in [p for p in pauses if p <= x]:
                until = now + pauses.pop(place)
        way.append(min(x, 10.0))
    one = np.column_stack([way, np.zeros_like(t), np.full_like(t, 2.0)])
    p = np.stack([one, one + np.array([0.0, gap, 0.0])], axis=1)
    v = np.gradient(p, DT, axis=0)
    return {"t": t, "position": p, "velocity": v}


def figures(gap=1.0, stops=(), trunk=TRUNK, radius=0.2):
    world = {"drone_radius": radius, "cylinders": [trunk], "boxes": [], "target_tolerance": 0.5,
             "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, gap, 2.0]]}}  # fmt: skip
    return safety(truth(gap, stops), world, ["a", "b"])


@pytest.mark.parametrize(
    ("gap", "radius", "collides", "below"),
    [(0.6, 0.2, 0, False), (0.49, 0.2, 0, True), (0.39, 0.2, 1, True), (0.39, 0.15, 0, False)],
)
def test_distances_between_drones(gap, radius, collides, below):
    f = figures(gap, radius=radius)
    assert f["mission_complete"]
    assert f["min_agent_distance_m"] == pytest.approx(gap)
    assert (f["agent_collisions"], f["below_agent_safety"]) == (collides, below)


@pytest.mark.parametrize(
    ("y", "collides", "below"), [(-1.0, 0, False), (-0.75, 0, True), (-0.65, 1, True)]
)
def test_distances_to_obstacles(y, collides, below):
    f = figures(trunk=TRUNK | {"y": y})
    assert f["min_obstacle_distance_m"] == pytest.approx(-y - 0.5, abs=1e-3)
    assert (f["obstacle_collisions"], f["below_obstacle_safety"]) == (collides, below)


def test_the_longest_standstill_is_that_before_the_last_target():
    assert figures()["longest_standstill_s"] == 0.0  # though both hover at the end
    assert figures(stops=(3.0, 5.0))["longest_standstill_s"] == pytest.approx(5.0, abs=3 * DT)
