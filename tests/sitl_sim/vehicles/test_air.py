"""Downwash and ground effect against their formulas, and what vehicles feel of them."""

import math

import numpy as np
import pytest

from mavlink_bridge.shared.constants import GRAVITY
from sitl_sim.vehicles.air import AirModel, Surroundings
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.downwash import AIR_DENSITY, LEGS, ground_gain, jet
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.ground import Ground

WIDTH = 2 * (0.11 + 0.0635)
WEIGHT = 0.7 * GRAVITY


def stacked(*offsets, **model):
    """Vehicles at 5 m and at `offsets` from there, all with hover thrust, after one step."""
    p = np.array([[0.0, 0.0, 5.0], *(np.add([0.0, 0.0, 5.0], o) for o in offsets)])
    vehicles = Vehicles(Airframe(), p, 0.0)
    vehicles.motor[:] = math.sqrt(Airframe().hover_thrust)
    around = Surroundings(vehicles, list(range(1, len(p) + 1)), AirModel(**model), Ground({}), 1)
    around.step(0.01, np.zeros_like(p))
    return vehicles, around


@pytest.mark.parametrize("below", [0.5, 2.0, 6.0])
def test_the_momentum_of_the_jet_is_the_thrust_at_any_distance(below):
    r = np.linspace(0.0, 5.0, 4001)
    speed = jet(np.full_like(r, below), r, np.array(WEIGHT), np.array(WIDTH))
    momentum = AIR_DENSITY * np.trapezoid(speed**2 * 2 * math.pi * r, r)
    assert momentum == pytest.approx(WEIGHT, rel=0.1)


def test_the_jet_spreads_and_slows_in_proportion_to_the_distance():
    origin = 3.5 * WIDTH
    near, far = jet(
        np.array([1.0, 1.0 + origin + 1.0]), np.zeros(2), np.array(WEIGHT), np.array(WIDTH)
    )
    assert near == pytest.approx(2.0 * far)
    half = 0.094 * (1.0 + origin)
    aside = jet(np.array(1.0), np.array(half), np.array(WEIGHT), np.array(WIDTH))
    assert aside == pytest.approx(0.5 * near, rel=1e-6)
    assert jet(np.array(-0.1), np.array(0.0), np.array(WEIGHT), np.array(WIDTH)) == 0.0


def test_a_drone_two_widths_below_another_loses_a_quarter_of_its_weight():
    """Neural-Swarm measured 9 g of 34 g for two Crazyflies at that distance in widths."""
    vehicles, around = stacked([0.0, 0.0, -0.7], downwash=True)
    np.testing.assert_array_equal(around.gusts[0], 0.0)  # the upper one feels nothing
    wind = around.gusts[1]
    assert wind[2] < -4.0
    drag = (0.07 + 0.015 * abs(wind[2])) * abs(wind[2])
    push = drag + (1.0 - vehicles.body.lift[1]) * WEIGHT
    assert push / WEIGHT == pytest.approx(9 / 34, abs=0.03)
    assert vehicles.body.lift[0] == 1.0
    before = vehicles.v[1, 2]
    vehicles.step(0.02, np.full((2, 4), math.sqrt(Airframe().hover_thrust)), around.gusts, 20)
    assert (before - vehicles.v[1, 2]) / 0.02 == pytest.approx(push / 0.7, rel=0.05)


def test_a_drone_at_the_edge_of_the_jet_is_tipped_towards_it():
    vehicles, _ = stacked([0.2, 0.0, -0.7], [3.0, 0.0, -0.7], downwash=True)
    roll, pitch, yaw = vehicles.body.torque[1]
    assert pitch < -0.001  # the rear, below the other, is pushed down: the nose goes up
    assert abs(roll) < 1e-12
    assert yaw == 0.0
    np.testing.assert_allclose(vehicles.body.torque[2], 0.0, atol=1e-9)


def test_ground_effect_is_cheeseman_and_bennetts():
    height = np.array([0.0, 0.05, 1.0])
    found = ground_gain(height, np.full(3, 0.0635))
    expected = 1 / (1 - (0.0635 / (4 * (height + LEGS))) ** 2)
    np.testing.assert_allclose(found, expected)
    assert found[0] == pytest.approx(1.11, abs=0.01)
    assert found[2] < 1.001
    assert ground_gain(np.array([0.0]), np.array([0.3]))[0] == 1.5  # no rotor gives infinite thrust


def test_without_keys_the_air_is_still_and_thrust_as_it_is():
    vehicles, around = stacked([0.0, 0.0, -0.7])
    assert around.gusts is None
    np.testing.assert_array_equal(vehicles.body.lift, 1.0)
    np.testing.assert_array_equal(vehicles.body.torque, 0.0)


def test_a_cushion_lifts_a_vehicle_off_before_its_hover_thrust():
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.02]], 0.0)
    around = Surroundings(vehicles, [1], AirModel(ground_effect=True), Ground({}), 1)
    around.step(0.01, np.zeros((1, 3)))
    vehicles.motor[:] = command = math.sqrt(0.98 * Airframe().hover_thrust)
    vehicles.step(0.05, np.full((1, 4), command), 0.0, 50)
    assert vehicles.v[0, 2] > 0.0
