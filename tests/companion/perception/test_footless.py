"""The distance of obstacles whose foot does not show, by geometry and odds."""

import numpy as np
import pytest

from companion.perception.footless import NEAREST, within

LIMITS = (0.05, 2.5)  # m, of radii
NONE = np.zeros(0)


def half(radius, surface):
    return float(np.arcsin(radius / (radius + surface)))


@pytest.mark.parametrize("surface", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("radius", [0.1, 0.3, 0.8])
def test_of_like_girth_it_is_where_its_width_says(radius, surface):
    found, sigma, beta = within(
        (0.0, 2.5), half(radius, surface), False, LIMITS, np.full(5, radius)
    )
    assert beta == half(radius, surface)
    assert found == pytest.approx(surface, rel=0.4)
    assert abs(found - surface) < 2.0 * sigma


def test_no_bound_is_passed_and_nothing_is_nearer_than_the_drone_reaches():
    for bound in (0.1, 0.5, 1.5, 4.0, 12.0):
        for beta in (0.02, 0.2, 0.8, 1.5):
            found, sigma, _ = within((0.0, bound), beta, False, LIMITS, np.array([0.3]))
            assert 0.9 * NEAREST <= found <= max(bound, 1.1 * NEAREST)
            assert 0.0 < sigma < max(bound, 1.0)
    found, _, _ = within((2.0, 3.0), 0.1, False, LIMITS, np.array([0.05]))
    assert 1.99 < found < 3.0


def test_a_thick_one_is_not_taken_for_a_thin_one_only_because_the_others_are():
    """One obstacle of ten is of another kind: where girth and bound disagree, the bound holds."""
    beta = half(0.1, 3.0)
    found, _, _ = within((2.0, 3.0), beta, False, LIMITS, np.full(4, 1.5))
    assert 2.0 < found < 3.0


def test_alone_it_is_as_likely_on_either_side_of_the_distance_of_least_relative_error():
    """Drawn as the docstring says: anywhere in the plane, each octave of radius alike."""
    rng = np.random.default_rng(5)
    r = np.exp(rng.uniform(np.log(0.05), np.log(2.5), 200_000))
    d = 10.0 * np.sqrt(rng.random(len(r)))
    t = d - r
    beta, bound = 0.15, 3.0
    like = (t > NEAREST) & (t < bound) & (np.abs(np.arcsin(np.minimum(r / d, 1.0)) - beta) < 0.02)
    found, sigma, _ = within((0.0, bound), beta, False, LIMITS, NONE)
    tried = np.linspace(0.3, 2.9, 200)
    cost = np.abs(tried[:, None] / t[like] - 1.0).mean(axis=1)
    best = tried[np.argmin(cost)]
    assert found == pytest.approx(best, rel=0.12)
    assert sigma == pytest.approx(np.sqrt(np.mean((t[like] - found) ** 2)), rel=0.12)


def test_what_the_picture_cuts_may_be_wider_and_nearer_than_it_shows():
    radii = np.full(5, 0.4)
    whole = within((0.0, 5.0), 0.1, False, LIMITS, radii)
    part = within((0.0, 5.0), 0.1, True, LIMITS, radii)
    assert whole[2] == 0.1
    assert 0.11 < part[2] < 0.3
    assert part[0] < whole[0]
