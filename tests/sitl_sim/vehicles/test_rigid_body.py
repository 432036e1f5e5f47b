"""The rigid body against physics: laws that hold for any implementation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavlink_bridge.shared.constants import GRAVITY
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import SUBSTEP, Vehicles

BARE = Airframe(drag_linear=(0.0, 0.0, 0.0), drag_quadratic=0.0)


def one(airframe=BARE, z=100.0, yaw=0.0):
    return Vehicles(airframe, [[0.0, 0.0, z]], yaw)


def run(vehicles, seconds, command=0.0, wind=0.0):
    u = np.full((len(vehicles), 4), command)
    vehicles.step(seconds, u, wind, round(seconds / SUBSTEP))


def test_hover_stays_where_it_is():
    airframe = Airframe()
    v = one(airframe)
    v.motor[:] = math.sqrt(airframe.hover_thrust)
    run(v, 2.0, math.sqrt(airframe.hover_thrust))
    np.testing.assert_allclose(v.p[0], [0.0, 0.0, 100.0], atol=1e-9)
    np.testing.assert_allclose(v.specific_force[0], [0.0, 0.0, GRAVITY], atol=1e-9)


def test_free_fall_is_exact_and_feels_nothing():
    v = one()
    run(v, 2.0)
    assert v.p[0, 2] == pytest.approx(100.0 - 0.5 * GRAVITY * 4.0, abs=1e-9)
    np.testing.assert_allclose(v.specific_force[0], 0.0, atol=1e-9)


def test_energy_is_kept_without_thrust_and_drag():
    v = one()
    v.v[:], v.omega[:] = [3.0, -2.0, 5.0], [4.0, -3.0, 6.0]
    inertia = np.array(BARE.inertia)

    def energy():
        spin = 0.5 * float((inertia * v.omega[0] ** 2).sum())
        return 0.5 * BARE.mass * float(v.v[0] @ v.v[0]) + BARE.mass * GRAVITY * v.p[0, 2] + spin

    before = energy()
    run(v, 3.0)
    assert energy() == pytest.approx(before, rel=1e-7)
    assert np.linalg.norm(v.q[0]) == pytest.approx(1.0, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-8.0, 8.0)] * 3))
def test_gyroscopic_torque_is_minus_omega_cross_j_omega(rates):
    v = one()
    omega = np.array(rates)
    v.omega[:] = omega
    inertia = np.array(BARE.inertia)
    run(v, 1e-3)
    expected = -np.cross(omega, inertia * omega) / inertia
    np.testing.assert_allclose(
        (v.omega[0] - omega) / 1e-3, expected, atol=0.02 + 2e-3 * omega @ omega
    )


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-5.0, 5.0)] * 3), st.tuples(*[st.floats(0.0, 1.0)] * 4))
def test_world_angular_momentum_follows_the_torque(rates, command):
    """Without motors the angular momentum in the world keeps still, however the body tumbles."""
    v = one()
    v.omega[:] = rates
    inertia = np.array(BARE.inertia)
    before = rotate(v.q[0], inertia * v.omega[0])
    run(v, 1.0)
    np.testing.assert_allclose(rotate(v.q[0], inertia * v.omega[0]), before, atol=1e-6)


def rotate(q, x):
    w, u = q[0], q[1:]
    return x + 2.0 * np.cross(u, np.cross(u, x) + w * x)


@pytest.mark.parametrize(
    ("raised", "axis", "sign"),
    [
        ((2, 3), 0, 1.0),  # left motors up: rolls right side down, +x
        ((0, 1), 0, -1.0),
        ((0, 2), 1, 1.0),  # rear motors up: nose down, +y
        ((1, 3), 1, -1.0),
        ((0, 3), 2, 1.0),  # clockwise motors up: turns left, +z
        ((1, 2), 2, -1.0),
    ],
)
def test_motors_turn_the_body_the_right_way(raised, axis, sign):
    v = one()
    u = np.full((1, 4), 0.5)
    v.motor[:] = 0.5
    u[0, list(raised)] = 0.6
    v.step(0.05, u, 0.0, 50)
    assert sign * v.omega[0, axis] > 0.02
    others = [k for k in range(3) if k != axis]
    np.testing.assert_allclose(v.omega[0, others], 0.0, atol=1e-9)


def test_mirror_image_flies_the_mirror_path():
    a, b = one(Airframe()), one(Airframe())
    ua, ub = np.array([[0.55, 0.6, 0.5, 0.65]]), np.array([[0.5, 0.65, 0.55, 0.6]])  # left ↔ right
    a.step(0.5, ua, [1.0, 2.0, 0.5], 500)
    b.step(0.5, ub, [1.0, -2.0, 0.5], 500)
    np.testing.assert_allclose(b.p, a.p * [1, -1, 1], atol=1e-9)
    np.testing.assert_allclose(b.omega, a.omega * [-1, 1, -1], atol=1e-9)


def test_motors_lag_with_their_time_constant():
    v = one()
    run(v, BARE.motor_time, 0.8)
    assert v.motor[0, 0] == pytest.approx(0.8 * (1 - math.exp(-1)), rel=1e-6)


def test_falling_ends_at_terminal_velocity_and_wind_carries():
    airframe = Airframe()
    v = one(airframe, z=1000.0)
    run(v, 20.0)
    speed = -v.v[0, 2]
    drag = airframe.drag_linear[2] * speed + airframe.drag_quadratic * speed**2
    assert drag == pytest.approx(airframe.mass * GRAVITY, rel=1e-3)
    w = one(airframe, z=1000.0)
    run(w, 5.0, 0.0, [4.0, 0.0, 0.0])
    assert 0.5 < w.v[0, 0] < 4.0


def test_rests_on_the_ground_without_sinking_and_feels_gravity():
    v = one(Airframe(), z=0.0)
    run(v, 1.0, 0.3)
    np.testing.assert_array_equal(v.p[0], 0.0)
    np.testing.assert_allclose(v.specific_force[0], [0.0, 0.0, GRAVITY], atol=1e-9)


def test_lands_without_bouncing_and_takes_off_again():
    v = one(Airframe(), z=0.3)
    heights = []
    for _ in range(100):
        run(v, 0.01)
        heights.append(v.p[0, 2])
    assert min(heights) == 0.0
    assert all(h == 0.0 for h in heights[heights.index(0.0) :])
    run(v, 0.5, 0.7)
    assert v.p[0, 2] > 0.1
    assert not v.state.contact[0]


def test_levels_on_the_ground():
    v = one(Airframe(), z=0.0)
    v.q[:] = [math.cos(0.2), math.sin(0.2), 0.0, 0.0]
    run(v, 1.0)
    np.testing.assert_allclose(v.q[0], [1, 0, 0, 0], atol=1e-3)


def test_vehicles_do_not_touch_each_other():
    rng = np.random.default_rng(1)
    u = rng.uniform(0.3, 0.8, (3, 4))
    together = Vehicles(Airframe(), [[0.0, 0.0, 50.0]] * 3, 0.0)
    together.step(0.5, u, 0.0, 500)
    for i in range(3):
        alone = one(Airframe(), z=50.0)
        alone.step(0.5, u[i : i + 1], 0.0, 500)
        np.testing.assert_array_equal(alone.p[0], together.p[i])
        np.testing.assert_array_equal(alone.q[0], together.q[i])


def test_wrong_number_of_airframes_is_refused():
    with pytest.raises(ValueError, match="2 airframes for 1 vehicles"):
        Vehicles([BARE, BARE], [[0, 0, 0]], 0.0)


def on_a_slope(degrees):
    """A vehicle that stands on a plane that rises to the east."""
    v = one(z=0.0)
    v.body.ground[:] = [0.0, math.tan(math.radians(degrees)), 0.0]
    v.state.contact[:] = True
    return v


def test_a_vehicle_stands_on_a_slope_of_ten_degrees_and_lies_along_it():
    v = on_a_slope(10.0)
    run(v, 2.0)
    np.testing.assert_allclose(v.p[0], 0.0, atol=1e-6)
    up = rotate(v.q[0], np.array([0.0, 0.0, 1.0]))
    slope = math.radians(10.0)
    np.testing.assert_allclose(up, [-math.sin(slope), 0.0, math.cos(slope)], atol=1e-3)


def test_a_vehicle_slides_down_a_slope_that_is_steeper_than_its_friction():
    v = on_a_slope(45.0)
    run(v, 0.5)
    along = math.sqrt(0.5) * GRAVITY * (1.0 - 0.7)  # sine less friction times cosine
    assert np.linalg.norm(v.v[0]) == pytest.approx(along * 0.5, rel=0.05)
    assert v.p[0, 2] == pytest.approx(v.p[0, 0], abs=0.01)
    assert v.p[0, 0] < 0.0


def test_a_fall_ends_on_the_slope():
    v = on_a_slope(10.0)
    v.p[0] = [3.0, 0.0, 1.5]
    run(v, 2.0)
    assert v.state.contact[0]
    assert v.p[0, 2] == pytest.approx(v.p[0, 0] * math.tan(math.radians(10.0)), abs=1e-3)
