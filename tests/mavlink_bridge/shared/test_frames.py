"""Frames, quaternions and thrust: round trips and known values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mavlink_bridge.shared import frames
from mavlink_bridge.shared.thrust import G, HoverThrustEstimator, ThrustMap

coordinate = st.floats(-1e3, 1e3)
unit_quaternion = (
    hnp.arrays(float, 4, elements=st.floats(-1, 1))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


@given(coordinate, coordinate, coordinate)
def test_vector_maps_are_their_own_inverse(x, y, z):
    assert frames.enu_ned(*frames.enu_ned(x, y, z)) == (x, y, z)
    assert frames.flu_frd(*frames.flu_frd(x, y, z)) == (x, y, z)


@given(unit_quaternion)
def test_quaternion_map_is_its_own_inverse_and_agrees_with_the_matrices(q):
    back = np.array(frames.quaternion_enu_ned(frames.quaternion_enu_ned(q)))
    assert np.allclose(back, q) or np.allclose(back, -q)
    t = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    s = np.diag([1, -1, -1])
    ned = frames.rotation_matrix(frames.quaternion_enu_ned(q))
    assert np.allclose(ned, t @ frames.rotation_matrix(q) @ s)


def test_level_and_facing_north_is_the_identity_in_ned():
    facing_north = frames.quaternion_from_euler(0, 0, np.pi / 2)
    assert np.allclose(np.abs(frames.quaternion_enu_ned(facing_north)), [1, 0, 0, 0])
    assert frames.heading_from_yaw(np.pi / 2) == pytest.approx(0)
    assert frames.yaw_from_heading(np.pi / 2) == pytest.approx(0)


@given(unit_quaternion, unit_quaternion)
def test_the_product_of_quaternions_is_the_product_of_rotations(a, b):
    r = frames.rotation_matrix(frames.multiply(a, b))
    assert np.allclose(r, frames.rotation_matrix(a) @ frames.rotation_matrix(b))
    assert np.allclose(frames.multiply(a, frames.conjugate(a)), [1, 0, 0, 0])


@given(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_euler_round_trip(roll, pitch, yaw):
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    assert np.allclose(frames.euler_from_quaternion(q), (roll, pitch, yaw), atol=1e-6)


@given(unit_quaternion, hnp.arrays(float, 3, elements=st.floats(-1.5, 1.5)))
def test_a_rotation_vector_is_found_again(q, rotation):
    turned = frames.rotate(q, rotation)
    relative = frames.multiply(frames.conjugate(q), turned)
    assert np.allclose(frames.rotation_vector(relative), rotation, atol=1e-8)
    assert np.allclose(frames.rotation_vector(-relative), rotation, atol=1e-8)
    assert np.allclose(frames.integrate(q, rotation, 1.0), turned, atol=1e-12)


@given(st.floats(0.5, 15), st.floats(0.2, 0.6), st.floats(1, 2))
def test_thrust_round_trip(c, hover, exponent):
    thrust_map = ThrustMap(hover, exponent)
    thrust = thrust_map.to_thrust(c)
    assert 0 <= thrust <= 1
    if thrust < 1:
        assert thrust_map.to_acceleration(thrust) == pytest.approx(c)
    assert thrust_map.to_thrust(G) == pytest.approx(hover)


@pytest.mark.parametrize("hover", [0.0, 1.0, -0.2, float("nan")])
def test_an_impossible_hover_thrust_is_refused(hover):
    with pytest.raises(ValueError, match="hover_thrust"):
        ThrustMap(hover)


def test_hover_thrust_is_estimated_in_flight():
    rng = np.random.default_rng(0)
    truth, estimator = ThrustMap(0.31), HoverThrustEstimator(ThrustMap(0.5))
    for _ in range(300):
        thrust = 0.31 + 0.05 * rng.standard_normal()
        measured = truth.to_acceleration(thrust) + 0.3 * rng.standard_normal()
        estimator = estimator.update(thrust, measured, 0.1)
    assert estimator.map.hover_thrust == pytest.approx(0.31, abs=0.01)
