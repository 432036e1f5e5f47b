"""Levels: the height of a find tells how likely it is a neighbour; the spread is learnt."""

import numpy as np
import pytest

from companion.perception.levels import Levels


def evidence(levels, height, sigma=0.05):
    return levels.evidence(np.array([height]), np.array([sigma]))[0]


def test_a_find_at_the_own_height_gains_and_one_far_off_loses():
    levels = Levels(0.3)
    assert evidence(levels, 0.0) > 1.0
    assert evidence(levels, 2.0) < -2.5
    assert evidence(levels, 1.0) == evidence(levels, -1.0)


def test_one_that_is_seen_clearly_counts_at_any_height():
    odds = np.log(0.99 / 0.01) + evidence(Levels(0.3), 10.0)
    assert 1 / (1 + np.exp(-odds)) > 0.8


def test_a_height_that_is_hardly_known_says_little():
    assert abs(evidence(Levels(0.3), 2.0, sigma=1.5)) < 0.8


def test_neighbours_at_other_heights_are_learnt_and_forgotten():
    levels = Levels(0.3)
    before = evidence(levels, 2.0)
    for _ in range(100):
        levels.follow(np.array([2.0, -0.1]))
    assert levels.sigma == pytest.approx(np.sqrt(2.0), rel=0.05)
    assert evidence(levels, 2.0) > before + 2.0
    for _ in range(400):
        levels.follow(np.array([0.05]))
    assert levels.sigma == 0.3  # never less than set
    assert evidence(levels, 2.0) == pytest.approx(before)


def test_nothing_is_said_where_it_is_switched_off():
    levels = Levels(0.0)
    levels.follow(np.array([3.0]))
    assert evidence(levels, 0.0) == evidence(levels, 5.0) == 0.0


def test_no_finds_gain_nothing():
    assert Levels(0.3).evidence(np.zeros(0), np.zeros(0)).shape == (0,)
