"""Thrust map and hover thrust estimator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap, exponent_of_curve


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


@pytest.mark.parametrize(("curve", "exponent"), [(0.0, 2.0), (1.0, 1.0)])
def test_the_exponent_of_an_autopilots_curve_at_its_ends(curve, exponent):
    for hover in (0.2, 0.5, 0.7):
        assert exponent_of_curve(curve, hover) == pytest.approx(exponent)


def test_the_exponent_is_the_slope_of_force_over_thrust_in_the_logarithm():
    def force(thrust, curve):
        """Of motors whose force goes with the square of their speed, by bisection."""
        low, high = 0.0, 1.0
        for _ in range(60):
            speed = (low + high) / 2
            less = curve * speed**2 + (1 - curve) * speed < thrust
            low, high = (speed, high) if less else (low, speed)
        return speed**2

    for curve, hover in ((0.3, 0.5), (0.65, 0.3), (0.9, 0.7)):
        slope = np.log(force(1.01 * hover, curve) / force(0.99 * hover, curve))
        slope /= np.log(1.01 / 0.99)
        assert exponent_of_curve(curve, hover) == pytest.approx(slope, rel=1e-3)
