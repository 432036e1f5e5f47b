"""The autopilot's thrust while it flies by itself: what is told, and whether it carries."""

import numpy as np
import pytest

from companion.estimation.autopilot_thrust import AutopilotThrust, AutopilotThrustReader
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.wire.messages import (
    AttitudeTarget,
    ExtendedSystemState,
    Heartbeat,
    ParamValue,
    VehicleState,
)

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
UNTOLD, ON_GROUND, IN_AIR, TAKING_OFF = (ExtendedSystemState(n) for n in (0, 1, 2, 3))
GROUND = 10.0  # m, where the vehicle is armed: the origin may lie anywhere


class Vehicle:
    """A vehicle as its messages tell of it."""

    def __init__(self, armed=None):
        """armed: its heartbeat, heard where it stands on the ground; None: none is heard."""
        self.identity = Identity("px4", 1)
        self.reader = AutopilotThrustReader(self.identity)
        if armed is not None:
            self.tells(Heartbeat(12, 2, False, MODES["hold"], 4), height=0.0)
            self.arm(armed)

    def arm(self, armed):
        self.identity.hear([Heartbeat(12, 2, armed, MODES["hold"], 4)])

    def tells(self, *messages, height=0.0, climb=0.0):
        """Return what one tick tells, at a height [m] over the ground, climbing [m/s]."""
        self.identity.hear(messages)
        p, v = np.array([90.0, -90.0, GROUND + height]), np.array([9.0, -9.0, climb])
        return self.reader.read(messages, VehicleState(0.0, p, v, LEVEL, np.zeros(3)))

    def flies(self, *messages, height=0.0, climb=0.0):
        """Return whether one tick tells that the motors carry the vehicle."""
        return self.tells(*messages, height=height, climb=climb).airborne


def target(time, thrust):
    return AttitudeTarget(time, LEVEL, np.zeros(3), thrust)


def test_a_vehicle_that_tells_nothing_does_not_fly():
    nothing = AutopilotThrust()
    assert (nothing.targets, nothing.hover, nothing.curve, nothing.airborne) == (
        (),
        None,
        None,
        False,
    )


def test_the_targets_of_one_tick_are_listed_in_their_order():
    vehicle = Vehicle(armed=True)
    told = vehicle.tells(target(4.0, 0.6), target(4.1, 0.0))
    assert told.targets == ((4.0, 0.6), (4.1, 0.0))
    assert vehicle.tells().targets == ()


@pytest.mark.parametrize("thrust", [np.nan, np.inf, -np.inf])
def test_a_target_without_a_number_is_left_out(thrust):
    told = Vehicle(armed=True).tells(target(4.0, thrust), target(4.1, 0.5))
    assert told.targets == ((4.1, 0.5),)


def test_the_parameters_are_told_for_as_long_as_they_are_known():
    vehicle = Vehicle(armed=True)
    vehicle.tells(
        ParamValue("MPC_THR_HOVER", 0.57, 9, 800, 3), ParamValue("THR_MDL_FAC", 0.3, 9, 800, 4)
    )
    told = vehicle.tells()
    assert (told.hover, told.curve) == (0.57, 0.3)


def test_without_a_heartbeat_or_a_state_no_vehicle_flies():
    assert not Vehicle().flies(IN_AIR, height=5.0)
    vehicle = Vehicle(armed=True)
    assert not vehicle.reader.read([IN_AIR], None).airborne
    assert vehicle.flies(height=5.0)  # what was told without a state is not lost


@pytest.mark.parametrize(
    ("height", "climb", "flies"),
    [(0.31, 0.31, True), (0.29, 2.0, False), (2.0, 0.29, False), (-0.5, 0.5, False)],
)
def test_a_vehicle_that_has_left_the_ground_and_climbs_flies(height, climb, flies):
    assert Vehicle(armed=True).flies(height=height, climb=climb) == flies


def test_a_vehicle_that_has_climbed_flies_on_until_it_stands():
    vehicle = Vehicle(armed=True)
    assert vehicle.flies(height=1.0, climb=0.5)
    assert vehicle.flies(height=0.1, climb=-1.0)
    assert not vehicle.flies(ON_GROUND)
    assert not vehicle.flies(UNTOLD, height=1.0)


def test_the_ground_is_where_the_vehicle_was_disarmed_last():
    vehicle = Vehicle(armed=True)
    assert vehicle.flies(height=5.0, climb=1.0)
    vehicle.arm(False)
    assert not vehicle.flies(height=4.0)  # on a roof
    vehicle.arm(True)
    assert not vehicle.flies(height=4.2, climb=1.0)
    assert vehicle.flies(height=4.4, climb=1.0)


def test_a_vehicle_that_was_armed_when_first_heard_shows_no_climb_from_the_ground():
    vehicle = Vehicle()
    vehicle.arm(True)
    assert not vehicle.flies(height=5.0, climb=1.0)
    assert vehicle.flies(IN_AIR, height=5.0)


def test_a_vehicle_told_to_be_in_the_air_flies_whatever_its_height():
    vehicle = Vehicle(armed=True)
    assert vehicle.flies(IN_AIR, height=-3.0)
    assert vehicle.flies(height=-3.0)  # it was told a tick ago
    assert not vehicle.flies(TAKING_OFF, height=-3.0)


def test_a_vehicle_told_to_stand_does_not_fly_however_it_climbs():
    vehicle = Vehicle(armed=True)
    assert not vehicle.flies(ON_GROUND, height=5.0, climb=2.0)
    assert not vehicle.flies(UNTOLD, height=5.0)  # that climb counted for nothing


def test_a_disarmed_vehicle_does_not_fly():
    vehicle = Vehicle(armed=True)
    assert vehicle.flies(IN_AIR, height=5.0, climb=1.0)
    vehicle.arm(False)
    assert not vehicle.flies(height=5.0, climb=1.0)
    vehicle.arm(True)
    assert not vehicle.flies(UNTOLD, height=5.0)


def test_a_vehicle_that_starts_anew_is_neither_high_nor_in_the_air():
    vehicle = Vehicle(armed=True)
    assert vehicle.flies(IN_AIR, height=5.0, climb=1.0)
    vehicle.reader.reset()
    assert not vehicle.flies(height=5.0)
    assert not vehicle.flies(height=9.0, climb=1.0)  # over ground of which nothing is known
