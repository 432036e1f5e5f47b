"""Thrust map and hover thrust estimator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import HoverThrustEstimator, ThrustMap


@given(st.floats(0.5, 15), st.floats(0.2, 0.6), st.floats(1, 2))
def test_the_thrust_gives_the_acceleration(c, hover, exponent):
    thrust_map = ThrustMap(hover, exponent)
    thrust = thrust_map.to_thrust(c)
    assert 0 <= thrust <= 1
    if thrust < 1:
        assert GRAVITY * (thrust / hover) ** exponent == pytest.approx(c)
    assert thrust_map.to_thrust(GRAVITY) == pytest.approx(hover)


@pytest.mark.parametrize("hover", [0.0, 1.0, -0.2, float("nan")])
def test_an_impossible_hover_thrust_is_refused(hover):
    with pytest.raises(ValueError, match="hover_thrust"):
        ThrustMap(hover)


def test_hover_thrust_is_estimated_in_flight():
    rng = np.random.default_rng(0)
    hover, estimator = 0.31, HoverThrustEstimator(ThrustMap(0.5))
    for _ in range(300):
        thrust = hover + 0.05 * rng.standard_normal()
        measured = GRAVITY * thrust / hover + 0.3 * rng.standard_normal()
        estimator = estimator.update(thrust, measured, 0.1)
    assert estimator.map.hover_thrust == pytest.approx(hover, abs=0.01)
