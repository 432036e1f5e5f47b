"""Hover thrust: learnt from the autopilot's thrust and from ours, with a doubt that holds."""

import numpy as np
import pytest

from companion.estimation.autopilot_thrust import AutopilotThrust, AutopilotThrustReader
from companion.estimation.hover_thrust import KNOWN, HoverThrust
from companion.estimation.input_history import InputHistory, SentInput
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import (
    AttitudeTarget,
    ExtendedSystemState,
    Heartbeat,
    ParamValue,
    VehicleState,
)

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
TILTED = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])  # by 0.4 rad


class Drone:
    """A drone of a true hover thrust that flies up and down; its estimate, tick by tick."""

    def __init__(
        self, true, configured=0.33, doubt=0.3, exponent=1.0, noise=0.0, q=LEVEL, assumed=None
    ):
        self.history = InputHistory(0.06)
        told = exponent if assumed is None else assumed
        self.hover = HoverThrust(ThrustMap(configured, told), doubt, self.history, assumed is None)
        self.true, self.exponent, self.q = true, exponent, q
        self.time, self.v = 5.0, np.zeros(3)
        self.rng, self.noise = np.random.default_rng(1), noise

    def fly(self, ticks, ours, told=None, wave=0.0, airborne=True):
        """Return the estimates; wave: share of g by which thrust goes up and down."""
        out = []
        up = np.array([0, 0, 1 - 2 * (self.q[1] ** 2 + self.q[2] ** 2)])
        axis = np.array([0.0, -2 * self.q[0] * self.q[1], up[2]])
        for k in range(ticks):
            share = 1.0 + wave * np.sin(0.5 * k)
            thrust = self.true * share ** (1 / self.exponent)
            targets = tuple((self.time + 0.1 * s - 0.03, thrust) for s in (0.5, 1.0))
            if ours:
                self.history.add(SentInput(self.time - 0.06, np.zeros(4), thrust))
            self.time += 0.1
            self.v = self.v + 0.1 * (GRAVITY * share * axis - [0.0, 0.0, GRAVITY])
            v = self.v + self.rng.normal(0.0, self.noise, 3)
            own = VehicleState(self.time, np.zeros(3), v, self.q, np.zeros(3))
            if told is None:
                said = AutopilotThrust(() if ours else targets, airborne=airborne)
            else:
                said = told
            out.append(self.hover.update(own, said, ours))
        return out


@pytest.mark.parametrize("true", [0.2, 0.33, 0.57, 0.7])
@pytest.mark.parametrize("configured", [0.2, 0.7])
def test_it_is_known_before_the_takeover_from_the_thrust_of_the_autopilot(true, configured):
    seen = Drone(true, configured, noise=0.02).fly(30, ours=False)
    assert not seen[1].known
    assert "known to ±" in seen[1].unknown_reason
    assert seen[-1].map.hover_thrust == pytest.approx(true, rel=0.03)
    assert seen[-1].known
    assert (seen[-1].source, seen[-1].unknown_reason) == ("autopilot", "")
    for e in seen:
        if e.known:
            assert abs(np.log(e.map.hover_thrust / true)) < 3 * e.doubt


def test_a_noisy_velocity_leaves_more_doubt_and_takes_longer():
    fine, coarse = (Drone(0.5, noise=n).fly(80, ours=False) for n in (0.01, 0.2))
    first = [next(k for k, e in enumerate(seen) if e.known) for seen in (fine, coarse)]
    assert first[0] + 3 < first[1] < 40
    assert coarse[-1].doubt > 2 * fine[-1].doubt


def test_a_tilted_drone_that_climbs_and_sinks_tells_the_same():
    seen = Drone(0.5, q=TILTED, exponent=2.0).fly(40, ours=False, wave=0.2)
    assert seen[-1].map.hover_thrust == pytest.approx(0.5, rel=0.03)


@pytest.mark.parametrize(("exponent", "assumed"), [(1.0, 2.0), (2.0, 1.0)])
def test_a_thrust_curve_other_than_the_assumed_one_is_learnt_too(exponent, assumed):
    """PX4 tells curve 0 of motors that its simulator lets pull in proportion."""
    drone = Drone(0.5, exponent=exponent, assumed=assumed, noise=0.02)
    drone.fly(20, ours=False)
    seen = drone.fly(60, ours=True, wave=0.25)
    assert seen[-1].map.hover_thrust == pytest.approx(0.5, rel=0.04)
    assert all(e.map.hover_thrust == pytest.approx(0.5, rel=0.15) for e in seen)
    assert abs(seen[-1].map.exponent - exponent) < 0.25


def test_on_the_ground_nothing_is_learnt():
    """The feet carry it: thrust says nothing of the weight."""
    (*_, last) = Drone(0.5).fly(40, ours=False, airborne=False)
    assert last.map.hover_thrust == pytest.approx(0.33)
    assert last.doubt == pytest.approx(0.3, abs=0.02)
    assert last.source == "configured"


@pytest.mark.parametrize(("factor", "mass"), [(0.75, 1.0), (1.0, 1.2)])
def test_a_change_in_flight_is_learnt_within_a_second_and_a_half(factor, mass):
    drone = Drone(0.33, noise=0.015)
    drone.fly(30, ours=True)
    before, drone.true = 0.33, 0.33 * mass / factor
    found = []
    for _ in range(30):  # thrust is as before, and gives less
        drone.history.add(SentInput(drone.time - 0.06, np.zeros(4), before))
        drone.time += 0.1
        drone.v = drone.v + 0.1 * GRAVITY * (before / drone.true - 1.0) * np.array([0, 0, 1])
        v = drone.v + drone.rng.normal(0.0, 0.015, 3)
        own = VehicleState(drone.time, np.zeros(3), v, LEVEL, np.zeros(3))
        found.append(drone.hover.update(own, AutopilotThrust(airborne=True), True))
    learnt = next(k for k, e in enumerate(found) if e.map.hover_thrust > 0.95 * drone.true)
    assert learnt <= 15
    assert min(e.mismatch for e in found) < -0.08  # the monitor sees it
    assert abs(found[-1].mismatch) < 0.05
    assert found[-1].source == "flight"


def test_between_two_masters_nothing_is_learnt():
    """Where not all of the interval was flown by our inputs, its motion says nothing of them."""
    drone = Drone(0.33)
    drone.fly(10, ours=True)
    known = drone.hover.estimate.map.hover_thrust
    drone.history.clear()
    drone.history.add(SentInput(drone.time, np.zeros(4), 0.9))
    own = VehicleState(drone.time + 0.1, np.zeros(3), drone.v, LEVEL, np.zeros(3))
    after = drone.hover.update(own, AutopilotThrust(airborne=True), True)
    assert after.map.hover_thrust == known


def test_the_autopilots_parameter_joins_the_configuration_once():
    hover = HoverThrust(ThrustMap(0.33), 0.3, InputHistory(0.06))
    told = AutopilotThrust(hover=0.57, curve=0.0)
    first, second = (hover.update(None, told, False) for _ in range(2))
    assert first.source == "parameter"
    assert 0.33 < first.map.hover_thrust < 0.57
    assert first.doubt == pytest.approx(1 / np.hypot(1 / 0.3, 1 / 0.2), rel=0.01)
    assert second == first
    assert not first.known  # nobody keeps that parameter up to date
    assert first.map.exponent == pytest.approx(2.0)


def test_a_doubt_that_is_configured_small_is_believed():
    assert HoverThrust(ThrustMap(0.33), KNOWN, InputHistory(0.06)).estimate.known


def test_impossible_numbers_change_nothing():
    hover = HoverThrust(ThrustMap(0.33), 0.3, InputHistory(0.06))
    for value in (0.0, -1.0, 7.0):
        hover.update(None, AutopilotThrust(hover=value, curve=value * 3 - 1), False)
    assert hover.estimate.source == "configured"
    assert hover.estimate.map.exponent == 1.0


def heartbeat(armed):
    return Heartbeat(12, 2, armed, MODES["hold"], 4)


def read(reader, identity, *messages, height, climb=0.0):
    identity.hear(messages)
    p, v = np.array([0.0, 0.0, height]), np.array([0.0, 0.0, climb])
    return reader.read(messages, VehicleState(0.0, p, v, LEVEL, np.zeros(3)))


def test_what_the_vehicle_tells_of_its_thrust():
    identity = Identity("px4", 1)
    reader = AutopilotThrustReader(identity)
    assert reader.read([], None) == AutopilotThrust()
    assert not read(reader, identity, heartbeat(False), height=1.0).airborne
    assert not read(reader, identity, heartbeat(True), height=1.1, climb=0.5).airborne
    assert not read(reader, identity, ExtendedSystemState(3), height=1.5).airborne  # drifts
    told = read(
        reader,
        identity,
        ParamValue("MPC_THR_HOVER", 0.57, 9, 800, 3),
        ParamValue("THR_MDL_FAC", 0.3, 9, 800, 4),
        AttitudeTarget(4.0, LEVEL, np.zeros(3), 0.6),
        AttitudeTarget(4.1, LEVEL, np.zeros(3), np.nan),
        height=1.5,
        climb=0.5,
    )
    assert told == AutopilotThrust(((4.0, 0.6),), 0.57, 0.3, airborne=True)
    assert read(reader, identity, height=2.0).airborne  # it has climbed
    assert not read(reader, identity, ExtendedSystemState(1), height=1.5).airborne
    assert read(reader, identity, ExtendedSystemState(2), height=1.5).airborne


def test_a_companion_that_starts_in_flight_believes_the_landed_state():
    identity = Identity("px4", 1)
    reader = AutopilotThrustReader(identity)
    assert not read(reader, identity, heartbeat(True), height=9.0).airborne
    assert read(reader, identity, ExtendedSystemState(2), height=9.0).airborne


@pytest.mark.parametrize(("sigma", "falls"), [(0.0, True), (0.1, False)])
def test_while_the_delay_is_in_doubt_a_changing_thrust_tells_little(sigma, falls):
    """A drone fell: 0.3 s late, it took a third of its hover thrust for the whole."""
    drone = Drone(0.33)
    drone.fly(30, ours=True)
    drone.history.delay_sigma = sigma
    shares = [1.0, 1.0, 1.0, 1.33, 1.36, 1.36, 1.3, 1.1, 0.93, 0.7, 0.5, 0.4, 0.4, 0.4]
    furthest = 0.0
    for k in range(3, len(shares)):
        drone.history.add(SentInput(drone.time - 0.06, np.zeros(4), 0.33 * shares[k]))
        drone.time += 0.1  # what acts was sent three ticks before
        drone.v = drone.v + 0.1 * GRAVITY * np.array([0.0, 0.0, shares[k - 3] - 1.0])
        own = VehicleState(drone.time, np.zeros(3), drone.v, LEVEL, np.zeros(3))
        seen = drone.hover.update(own, AutopilotThrust((), airborne=True), ours=True)
        furthest = max(furthest, abs(np.log(seen.map.hover_thrust / 0.33)))
    assert (furthest > 0.3) == falls
    assert furthest > 0.3 or furthest < 0.06


@pytest.mark.parametrize(("true", "bound"), [(0.7, 1.0), (2.6, 2.0)])
def test_no_flight_takes_the_exponent_beyond_that_of_motors(true, bound):
    drone = Drone(0.5, configured=0.5, exponent=true, assumed=1.5)
    exponents = [e.map.exponent for e in drone.fly(120, ours=True, wave=0.3)]
    assert exponents[-1] == pytest.approx(bound, abs=0.01)
    assert 1.0 <= min(exponents) <= max(exponents) <= 2.0
