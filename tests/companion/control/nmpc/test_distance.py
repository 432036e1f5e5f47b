"""The NMPC's margins and `mavlink_bridge.shared.distance` are the same distances, (37) and (38)."""

import casadi as ca
import numpy as np
import pytest

from companion.control.nmpc import NmpcConfig
from companion.control.nmpc.constraints import agent_margins, cylinder_margins
from companion.control.nmpc.parameters import (
    ParameterVectors,
    scene_symbols,
    weight_numbers,
    weight_symbols,
)
from mavlink_bridge.shared.distance import between, to_cylinder

CONFIG = NmpcConfig()


def margins(function, config, p, **parts):
    """Margins of a function at p (3,), with these numbers as parts of the scene."""
    scene_vector, stage_vector, scene = scene_symbols(config)
    weights, w = weight_symbols()
    position = ca.SX.sym("p", 3)
    f = ca.Function(
        "f", [position, scene_vector, stage_vector, weights], [function(position, scene, w)]
    )
    vectors = ParameterVectors(config)
    for name, numbers in parts.items():
        (vectors.of_scene | vectors.of_stages)[name][...] = numbers
    return np.array(f(p, vectors.scene, vectors.stages[0], weight_numbers(config))).ravel()


@pytest.mark.parametrize("scale", [1.0, 4.0, 7.0])
def test_distance_to_neighbours_is_the_same_ellipsoid(scale):
    config, rng = (
        CONFIG.model_copy(update={"agent_vertical_scale": scale}),
        np.random.default_rng(7),
    )
    p, others = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, (CONFIG.neighbours, 3))
    safety = rng.uniform(0.5, 1.0, CONFIG.neighbours)
    parts = {"neighbour_p": others, "neighbour_safety": safety, "neighbour_active": 1.0}
    found = margins(agent_margins, config, p, **parts)
    assert np.allclose(found + safety, between(others, p, scale), atol=1e-5)


def test_distance_to_trunks_is_the_same_cylinder():
    rng = np.random.default_rng(8)
    p, trunks = rng.uniform(-2, 2, 3), rng.uniform(0.1, 3, (CONFIG.cylinders, 3))
    found = margins(cylinder_margins, CONFIG, p, cylinders=trunks, cylinder_active=1.0)
    assert np.allclose(found + CONFIG.d_obstacle_safety, to_cylinder(p, *trunks.T), atol=1e-5)
