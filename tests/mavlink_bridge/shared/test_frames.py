"""Frames and quaternions: round trips and known values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mavlink_bridge.shared import frames

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
