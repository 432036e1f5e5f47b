"""Each number reaches the symbol of its name: no two may be swapped unnoticed."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from companion.control.nmpc import Instance, NmpcConfig
from companion.control.nmpc.parameters import (
    WEIGHTS,
    ParameterVectors,
    Scene,
    scene_symbols,
    scene_table,
    stage_table,
    weight_numbers,
    weight_symbols,
)
from tests.companion.control.nmpc.scenes import CONFIG, NAMED, scene

J, K, H = CONFIG.neighbours, CONFIG.cylinders, CONFIG.planes
TABLES = {"weights": WEIGHTS, "scene": scene_table(CONFIG), "stages": stage_table(CONFIG)}


def read(vector, symbols, numbers):
    """The numbers that each symbol of a vector reads, in the shape that numpy gives them."""
    names = list(symbols)
    found = ca.Function("read", [vector], [symbols[name] for name in names])(numbers)
    return {name: np.array(x).T.squeeze() for name, x in zip(names, found, strict=True)}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_each_symbol_reads_the_numbers_of_its_name(table):
    numbers = np.full(table.size, np.nan)
    views, first = table.views(numbers), 0.0
    for view in views.values():
        view[...] = first + np.arange(view.size).reshape(view.shape)
        first += view.size
    assert sorted(numbers) == list(range(table.size))  # every place belongs to one name
    for name, found in read(*table.symbols("vector"), numbers).items():
        np.testing.assert_array_equal(found, views[name].squeeze(), err_msg=name)


def test_each_weight_is_the_number_of_its_key():
    distinct = {name: 1.0 + 0.01 * n for n, name in enumerate(WEIGHTS.slices)}
    config = CONFIG.model_copy(update=distinct)
    assert read(*weight_symbols(), weight_numbers(config)) == distinct


def test_each_number_of_an_instance_is_read_by_the_symbol_of_its_name():
    config = CONFIG.model_copy(update={"tie_break": 0.0})
    rng = np.random.default_rng(0)
    shapes = {
        "x0": 10,
        "u_last": 4,
        "goal": 3,
        "disturbance": 3,
        "neighbour_p": (J, 3),
        "neighbour_v": (J, 3),
        "neighbour_sigma": (J, 2),
        "neighbour_cohesion": J,
        "neighbour_active": J,
        "cylinders": (K, 3),
        "cylinder_active": K,
        "planes": (H, 4),
        "plane_active": H,
    }
    distinct = {name: rng.uniform(0.1, 1.0, shape) for name, shape in shapes.items()}
    instance = Instance(speed=1.2, v_max=1.7, yaw=0.4, **distinct)
    vectors = ParameterVectors(config)
    vectors.fill(instance)
    k = 4
    scene_vector, stage_vector, symbols = scene_symbols(config)
    names = [f.name for f in dataclasses.fields(Scene)]
    f = ca.Function("f", [scene_vector, stage_vector], [getattr(symbols, name) for name in names])
    found = f(vectors.scene, vectors.stages[k - 1])
    origin, active = instance.x0[:3], instance.neighbour_active
    sigma = np.hypot(instance.neighbour_sigma[:, 0], k * config.dt * instance.neighbour_sigma[:, 1])
    wanted = {
        "goal": instance.goal - origin,
        "speed": 1.2,
        "sight": [np.cos(0.4), np.sin(0.4)],
        "disturbance": instance.disturbance,
        "v_max": 1.7,
        "cylinders": instance.cylinders - [*origin[:2], 0.0],
        "cylinder_active": instance.cylinder_active,
        "planes": instance.planes
        - np.column_stack([np.zeros((H, 3)), instance.planes[:, :3] @ origin]),
        "plane_active": instance.plane_active,
        "neighbour_p": instance.neighbour_p + k * config.dt * instance.neighbour_v - origin,
        "neighbour_safety": config.d_agent_safety + np.minimum(sigma, config.widening_max),
        "neighbour_active": active,
        "cohesion": instance.neighbour_cohesion * active / J,
    }
    assert set(names) == set(wanted)
    for name, numbers in zip(names, found, strict=True):
        np.testing.assert_allclose(np.array(numbers).T.squeeze(), wanted[name], err_msg=name)


def test_distances_and_cohesion_end_with_their_horizons():
    vectors = ParameterVectors(CONFIG)
    vectors.fill(scene(**NAMED["side by side"]))
    for name, last in (("neighbour_active", CONFIG.M_constraint), ("cohesion", CONFIG.M)):
        np.testing.assert_array_equal(vectors.of_stages[name][:, 0] > 0, np.arange(CONFIG.N) < last)


def test_uncertainty_widens_the_safety_distance_up_to_a_limit():
    vectors = ParameterVectors(CONFIG)
    vectors.fill(scene(**NAMED["unsure"]))
    safety = vectors.of_stages["neighbour_safety"][:, 0]
    assert safety[0] == pytest.approx(0.8 + np.hypot(0.1, 0.03))
    assert np.all(np.diff(safety) >= 0)
    assert safety[-1] == pytest.approx(0.8 + CONFIG.widening_max)


def test_neighbours_are_predicted_at_constant_velocity():
    vectors = ParameterVectors(CONFIG)
    vectors.fill(scene(**NAMED["head-on"]))
    predicted = vectors.of_stages["neighbour_p"][9, 0]
    np.testing.assert_allclose(predicted, [4 - 1.5, 0.2, 0], atol=1e-12)


def test_an_exact_tie_is_broken_to_the_right_and_no_other_cylinder_moves():
    vectors = ParameterVectors(CONFIG)
    vectors.fill(scene(cylinders=[(4, 0, 1), (4, 0.5, 1), (-4, 0, 1)]))
    moved = [(4, CONFIG.tie_break, 1), (4, 0.5, 1), (-4, 0, 1)]
    np.testing.assert_allclose(vectors.of_scene["cylinders"][:3], moved)


@pytest.mark.parametrize("sizes", [{"neighbours": 0}, {"cylinders": 0, "planes": 2}])
def test_a_table_has_room_for_parts_without_numbers(sizes):
    config = NmpcConfig(**sizes)
    vectors = ParameterVectors(config)
    assert vectors.scene.size == scene_table(config).size
    assert vectors.of_stages["neighbour_p"].shape == (config.N, config.neighbours, 3)
