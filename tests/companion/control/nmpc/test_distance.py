"""The NMPC's margins and the measure of everything else are the same distances."""

import casadi as ca
import numpy as np

from companion.control.nmpc import NmpcConfig
from companion.control.nmpc.constraints import agent_margins, cylinder_margins
from companion.control.nmpc.parameters import scene_symbols, weight_numbers, weight_symbols
from mavlink_bridge.shared.distance import between, to_cylinder

CONFIG = NmpcConfig()


def margins(of, p, **given):
    """What `of` gives at p (3,), with these numbers in the scene and all else zero."""
    symbol, w = weight_symbols()
    *_, scene = scene_symbols(CONFIG)
    where = ca.SX.sym("p", 3)
    symbols = [getattr(scene, name) for name in given]
    f = ca.Function("f", [where, symbol, *symbols], [of(where, scene, w)])
    return np.array(f(p, weight_numbers(CONFIG), *given.values())).ravel()


def test_distance_to_neighbours_is_one_measure():
    rng = np.random.default_rng(7)
    p, others = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, (CONFIG.neighbours, 3))
    safety = rng.uniform(0.5, 1.0, CONFIG.neighbours)
    found = margins(agent_margins, p, neighbour_p=others.T, neighbour_safety=safety,
                    neighbour_active=np.ones(CONFIG.neighbours))  # fmt: skip
    assert np.allclose(found + safety, between(others, p, CONFIG.agent_vertical_scale), atol=1e-5)


def test_distance_to_trunks_is_one_measure():
    rng = np.random.default_rng(8)
    p, trunks = rng.uniform(-2, 2, 3), rng.uniform(0.1, 3, (CONFIG.cylinders, 3))
    found = margins(cylinder_margins, p, cylinders=trunks.T,
                    cylinder_active=np.ones(CONFIG.cylinders))  # fmt: skip
    assert np.allclose(found + CONFIG.d_obstacle_safety, to_cylinder(p, *trunks.T), atol=1e-5)
