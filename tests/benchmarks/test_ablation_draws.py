"""Least squares over flights that each leave out a few rules."""

import numpy as np

from tests.benchmarks.ablation_draws import effects, lines


def test_effects_of_rules_are_found_beside_each_other():
    rng = np.random.default_rng(3)
    off = rng.random((400, 4)) < 0.3
    off[:, 3] = False
    y = 60.0 + off @ [5.0, 0.0, -3.0, 0.0] + rng.normal(0.0, 1.0, 400)
    y[::7] = np.nan  # did not arrive
    found, errors = effects(off, y)
    np.testing.assert_allclose(found[:3], [5.0, 0.0, -3.0], atol=0.4)
    np.testing.assert_allclose(errors[:3], 1.0 / np.sqrt(343 * 0.3 * 0.7), rtol=0.15)
    assert np.isnan(found[3])
    assert np.isnan(errors[3])


def test_contacts_are_counted_without_a_rule_and_with_it():
    off = np.array([[True], [False], [False], [True]])
    found = [
        {
            "agent_collisions": contacts,
            "obstacle_collisions": 0,
            "min_agent_distance_m": 0.5,
            "mission_time_s": time,
            "certified_share": 0.9,
        }
        for contacts, time in ((2, 50.0), (0, 60.0), (1, None), (0, 52.0))
    ]
    (line,) = lines(["a rule"], off, found)
    assert line.split()[:9] == ["a", "rule", "1", "of", "2", "|", "1", "of", "2"]
    assert "-9.000 ±" in line
