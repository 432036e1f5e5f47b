"""The line of sight by what it would tell: all round in turns, never off who threatens."""

import math

import numpy as np
import pytest

from companion.guidance.gaze import Gaze, GazeConfig, Near, make_gaze, wrap
from companion.guidance.informed_gaze import InformedGaze

FAR = np.array([20.0, 0.0, 0.0])
INFORMED = GazeConfig(kind="informed", survey=0.0, seed=3)


def looked(speed, near=(), seconds=20.0, config=INFORMED, close=None):
    """ψ of each tick, of a drone that turns as it is asked to; its way leads east."""
    gaze, psi = make_gaze(config), [0.0]
    for k in range(int(seconds * 10)):
        gaze.mind(near)
        v = np.array([speed, 0.0, 0.0])
        psi.append(gaze.update(k / 10, v, FAR, psi[-1], close=close))
    return np.array(psi[1:])


def longest_unseen(psi):
    """The longest time [s] for which any direction was out of view; half the view is 1.2 rad."""
    directions = np.linspace(-np.pi, np.pi, 36)
    off = np.abs((directions - psi[:, None] + np.pi) % (2 * np.pi) - np.pi)
    longest, since = 0, np.zeros(36)
    for row in off < 1.2:
        since = np.where(row, 0, since + 1)
        longest = max(longest, since.max())
    return longest / 10


def test_it_is_chosen_by_its_name():
    assert isinstance(make_gaze(INFORMED), InformedGaze)


def test_a_drone_that_stands_looks_all_round_again_and_again():
    assert longest_unseen(looked(0.0)) < 10.0  # the sweep alone leaves half of it out for ever


@pytest.mark.parametrize("speed", [0.8, 1.6])
def test_a_drone_that_flies_sees_its_way(speed):
    psi = looked(speed)
    assert np.abs(psi).max() <= INFORMED.limit + 1e-9
    assert psi.min() < -0.3
    assert psi.max() > 0.3
    assert np.abs(np.diff(psi)).max() <= INFORMED.slew * 0.1 + 1e-9


def test_the_slower_it_is_the_farther_it_may_look_round():
    most = [np.abs(looked(speed)).max() for speed in (0.3, 0.55, 0.7)]
    assert most[0] > 2.0
    assert most == sorted(most, reverse=True)


def test_who_threatens_is_not_lost_for_long_while_the_drone_looks_round():
    gaze, psi, unseen, longest, farthest = make_gaze(INFORMED), 0.0, 0.0, 0.0, 0.0
    for k in range(300):
        gaze.mind([Near(0.5, 1.0, unseen)])
        psi = gaze.update(k / 10, np.zeros(3), FAR, psi)
        unseen = 0.0 if abs(wrap(0.5 - psi)) < 1.3 else unseen + 0.1
        longest, farthest = max(longest, unseen), max(farthest, abs(psi))
    assert farthest > 2.0
    assert 0.5 < longest < 3.5


def test_a_neighbour_behind_that_is_not_seen_is_looked_for():
    psi = looked(0.0, [Near(math.pi, 0.6, 2.0)], seconds=3.0)
    assert np.abs([wrap(math.pi - yaw) for yaw in psi]).min() < 1.2


def test_the_longer_and_the_worse_counts_of_two_that_are_not_seen():
    for worse, other in (((0.5, 3.0), (0.5, 1.0)), ((0.8, 1.0), (0.2, 1.0))):
        psi = looked(0.0, [Near(2.2, *worse), Near(-2.2, *other)], seconds=2.0)
        assert wrap(psi[-1]) > 0.9


def test_without_a_sweep_it_looks_along_the_way():
    still = INFORMED.model_copy(update={"sigma": 0.0})
    assert np.allclose(looked(0.0, config=still), 0.0)


def test_the_sweep_needs_to_mind_nobody():
    sweep, alone = Gaze(GazeConfig(survey=0.0, seed=3)), Gaze(GazeConfig(survey=0.0, seed=3))
    for k in range(100):
        sweep.mind([Near(2.0, 2.0, 3.0)])
        args = k / 10, np.array([1.0, 0.0, 0.0]), FAR, 0.0
        assert sweep.update(*args) == alone.update(*args)
