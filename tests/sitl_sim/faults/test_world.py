"""Faults of vehicles, autopilots and processes begin and end in time."""

import resource
import subprocess

import numpy as np
import pytest

from sitl_sim.faults.catalogue import Fault, FaultConfig, Schedule
from sitl_sim.faults.world import FaultyWorld
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise

FILE_SIZE = resource.RLIMIT_FSIZE


def test_a_vehicle_is_whole_again_after_its_faults(schedule):
    vehicles = Vehicles(Airframe(), np.zeros((2, 3)), 0.0)
    whole = vehicles.body.thrust_max.copy()
    s = schedule(kind="motor", drone="drone2", at=1.0, amount=0.8, **{"for": 1.0})
    world = FaultyWorld(s, vehicles, None)
    world.update(0.5)
    assert (vehicles.body.thrust_max == whole).all()
    world.update(1.0)
    assert sorted((vehicles.body.thrust_max / whole)[1].round(6)) == [0.8, 1, 1, 1]
    assert (vehicles.body.thrust_max[0] == whole[0]).all()
    world.update(2.0)
    assert (vehicles.body.thrust_max == whole).all()
    dead = FaultyWorld(schedule(kind="motor", amount=0.0, at=1.0, **{"for": 1.0}), vehicles, None)
    for t in (0.0, 1.0, 2.0):
        dead.update(t)
        assert (vehicles.body.thrust_max == 0.0).sum() == 2 * (t == 1.0)
    assert (vehicles.body.thrust_max == whole).all()
    configs = [
        {"kind": "thrust_scale", "at": float(k), "for": 2.0, "amount": a}
        for k, a in enumerate((0.5, 0.8))
    ]
    faults = [FaultConfig.model_validate(c) for c in configs]
    both = FaultyWorld(Schedule(faults, ["drone1", "drone2"], 1), vehicles, None)
    for t, share in enumerate((0.5, 0.4, 0.8, 1.0)):
        both.update(float(t))
        assert (vehicles.body.thrust_max / whole).ravel() == pytest.approx([share] * 8)
    gusts = FaultyWorld(schedule(kind="gust", amount=5.0), vehicles, None, wind=[1.0, 0.0, 0.0])
    wind = gusts.wind(0.0)
    assert np.linalg.norm(wind - [1.0, 0, 0], axis=1) == pytest.approx([5.0, 5.0])
    assert isinstance(next(iter(s.all())), Fault)


@pytest.fixture
def victim():
    """Id of a process whose files can be kept from growing."""
    with subprocess.Popen(["sleep", "60"]) as process:
        yield process.pid
        process.kill()


@pytest.mark.parametrize("first", [2.0, 4.0])  # s it lasts: ends before the second, or after it
@pytest.mark.parametrize(
    ("kind", "state", "once", "both"),
    [
        ("gyro_bias", lambda a: (a.gyro_bias(0) - a.truly)[0], 0.05, 0.1),
        ("position_jump", lambda a: a.offset[0, 0], 3.0, 6.0),
        ("position_lost", lambda a: float("gps" in a.units[0].commander.failed), 1.0, 1.0),
        ("disk_full", lambda a: float(resource.prlimit(a.pid, FILE_SIZE)[0] == 0), 1.0, 1.0),
    ],
)
def test_overlapping_faults_end_each_in_its_time(victim, kind, state, once, both, first):
    vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
    a = Autopilots(vehicles, [1])
    a.truly, a.offset, a.pid = a.gyro_bias(0), a.errors.offset, victim
    times = [{"at": 1.0, "for": first}, {"at": 2.0, "for": 2.0}]
    faults = [FaultConfig.model_validate({"kind": kind} | t) for t in times]
    world = FaultyWorld(Schedule(faults, ["drone1"], 1), vehicles, a, lambda i: victim)
    found = []
    for t in range(6):
        world.update(float(t))
        found.append(state(a))
    expected = [0.0, once, both, *([both, once] if first == 4.0 else [once, 0.0]), 0.0]
    assert found == pytest.approx(expected)


def test_a_reboot_repairs_no_sensor():
    vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
    a = Autopilots(vehicles, [1])
    faults = [{"kind": "position_lost", "for": 2.0}, {"kind": "reboot", "at": 1.0}]
    configs = [FaultConfig.model_validate(f) for f in faults]
    world = FaultyWorld(Schedule(configs, ["drone1"], 1), vehicles, a)
    found = []
    for t in range(3):
        world.update(float(t))
        found.append("gps" in a.units[0].commander.failed)
    assert found == [True, True, False]


def estimator_fault(kind, seconds, **more):
    """Autopilots of one vehicle on the ground, with such a fault from 1 s on for 2 s."""
    vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
    a = Autopilots(vehicles, [1], noise=SensorNoise.none())
    config = FaultConfig.model_validate({"kind": kind, "at": 1.0, "for": 2.0} | more)
    world = FaultyWorld(Schedule([config], ["drone1"], 1), vehicles, a)
    for k in range(round(seconds * 50)):
        world.update(k / 50)
        a.advance((k + 1) / 50)
    return a


def test_a_reset_of_the_position_is_counted_and_stays():
    a = estimator_fault("position_reset", 5.0)
    assert np.hypot(*a.estimate[0, :2]) == pytest.approx(3.0)
    assert a.errors.resets[0] == 1
    silent = estimator_fault("position_jump", 2.0)
    assert np.hypot(*silent.estimate[0, :2]) == pytest.approx(3.0)
    assert silent.errors.resets[0] == 0


def test_a_wrong_compass_turns_the_yaw_and_not_the_position():
    a = estimator_fault("compass", 2.95)
    yaw = 2 * np.degrees(np.arcsin(a.units[0].sample().q[3]))
    assert yaw == pytest.approx(20.0 * (1 - np.exp(-1.95 / 2.0)), abs=0.2)
    np.testing.assert_allclose(a.estimate[0], 0.0, atol=1e-9)
    assert a.errors.heading_ratio[0] > 0.11


def test_the_height_drifts_while_the_fault_lasts_and_the_velocity_shows_nothing():
    a = estimator_fault("height_drift", 5.0, amount=6.0)
    np.testing.assert_allclose(a.estimate[0], [0.0, 0.0, 0.2], atol=0.003)
    np.testing.assert_allclose(a.units[0].sample().v, 0.0, atol=1e-9)


def test_a_velocity_slides_with_its_position_and_is_right_again():
    during = estimator_fault("velocity_slide", 2.9)
    wrong = during.units[0].sample().v
    assert np.hypot(*wrong[:2]) == pytest.approx(0.8 * (1 - np.exp(-1.9)), abs=0.02)
    assert wrong[2] == 0.0
    after = estimator_fault("velocity_slide", 12.0)
    np.testing.assert_allclose(after.units[0].sample().v, 0.0, atol=1e-3)
    assert np.hypot(*after.estimate[0, :2]) == pytest.approx(0.8 * 2.0, abs=0.03)
    assert after.errors.resets[0] == 0


def test_a_solution_that_floats_is_off_says_so_and_comes_back():
    floats = estimator_fault("rtk_float", 2.9)
    assert np.hypot(*floats.estimate[0, :2]) == pytest.approx(0.4, abs=0.01)
    assert floats.errors.position_sigma[0, 0] == pytest.approx(0.3)
    again = estimator_fault("rtk_float", 6.0)
    assert np.hypot(*again.estimate[0, :2]) < 0.01
    assert again.errors.position_sigma[0, 0] == pytest.approx(0.1)
