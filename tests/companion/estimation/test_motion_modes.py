"""The two modes of motion: what mixing keeps, and what looks tell of them."""

import numpy as np
import pytest

from companion.estimation.motion_modes import Modes


def some(n=3, states=4):
    rng = np.random.default_rng(n)
    root = rng.normal(size=(2 * n, states, states))
    weight = rng.uniform(0.05, 0.95, n)
    return Modes(np.stack([weight, 1.0 - weight]), rng.normal(size=(2 * n, states)), root @ root.mT)


def test_the_mixture_is_that_of_two_normal_distributions():
    modes = some(1)
    rng = np.random.default_rng(5)
    on = rng.random(400_000) < modes.weight[0, 0]
    drawn = np.where(
        on[:, None],
        rng.multivariate_normal(modes.mean[0], modes.covariance[0], len(on)),
        rng.multivariate_normal(modes.mean[1], modes.covariance[1], len(on)),
    )
    mean, covariance = modes.mixture()
    assert mean[0] == pytest.approx(drawn.mean(axis=0), abs=0.03)
    assert covariance[0] == pytest.approx(np.cov(drawn.T), abs=0.1)


def test_passing_over_changes_the_modes_and_not_their_mixture():
    modes, change = some(), np.array([0.1, 0.3])
    before, weight = modes.mixture(), modes.weight.copy()
    apart = np.linalg.norm(modes.mean[:3] - modes.mean[3:], axis=1)
    modes.mix(change)
    for now, then in zip(modes.mixture(), before, strict=True):
        assert now == pytest.approx(then)
    assert modes.weight[0] == pytest.approx(0.9 * weight[0] + 0.3 * weight[1])
    assert modes.weight.sum(axis=0) == pytest.approx(1.0)
    assert (np.linalg.norm(modes.mean[:3] - modes.mean[3:], axis=1) < apart).all()


def test_nothing_passes_over_at_no_rate():
    modes, before = some(), some()
    modes.mix(np.zeros(2))
    assert modes.mean == pytest.approx(before.mean)
    assert modes.covariance == pytest.approx(before.covariance)


def test_what_is_seen_weighs_the_modes_by_bayes_rule():
    modes, before = some(), some()
    modes.weigh(np.array([2, 0]), np.log([[0.2, 3.0], [0.8, 1.0]]))
    for track, ratio in ((2, 0.25), (0, 3.0), (1, 1.0)):
        a, b = before.weight[:, track]
        assert modes.weight[:, track] == pytest.approx(np.array([ratio * a, b]) / (ratio * a + b))


def test_no_mode_is_ever_ruled_out():
    modes = some(1)
    for _ in range(5):
        modes.weigh(np.array([0]), np.array([[0.0], [-1e4]]))
    assert modes.weight[:, 0] == pytest.approx([0.999, 0.001], rel=0.01)


def test_tracks_are_added_last_and_kept_in_both_modes():
    modes, before = some(), some()
    modes.add(np.arange(4.0), np.eye(4))
    left = modes.kept(np.array([False, True, False, True]))
    assert left.weight == pytest.approx(np.column_stack([before.weight[:, 1], [0.5, 0.5]]))
    rows = [before.mean[1], np.arange(4.0), before.mean[4], np.arange(4.0)]
    assert left.mean == pytest.approx(np.array(rows))
    squares = [before.covariance[1], np.eye(4), before.covariance[4], np.eye(4)]
    assert left.covariance == pytest.approx(np.array(squares))


def test_a_copy_shares_nothing():
    modes = some()
    copy = modes.copy()
    copy.mean += 1.0
    copy.covariance += 1.0
    copy.weigh(np.array([0]), np.array([[0.0], [-1.0]]))
    again = some()
    assert modes.mean == pytest.approx(again.mean)
    assert modes.covariance == pytest.approx(again.covariance)
    assert modes.weight == pytest.approx(again.weight)
