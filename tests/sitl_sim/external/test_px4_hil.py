"""A PX4 on the simulator's physics; the stand-in refuses what PX4 refuses."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl_sim.external import lockstep_fleet, px4_hil
from sitl_sim.external.airframe_parameters import px4_parameters
from sitl_sim.external.hil_sensors import HilSensors
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.external.px4_hil import Px4Sitl
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

ARM = mavlink.MAVLink_command_long_message(4, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


class Noiseless(HilSensors):
    """Sensors as they were: of a vehicle at rest every sample is the same."""

    def imu(self, time, i, state):
        first = super().imu(time, i, state)
        self._kept = getattr(self, "_kept", first)
        return replace(self._kept, time=time)


@pytest.fixture
def fleet(tmp_path, stand_in, monkeypatch):
    """A function that boots a fleet of one stand-in, with sensors of a kind."""
    monkeypatch.setattr(lockstep_fleet, "_ARMABLE", 3.0)
    running = []

    def boot(kind=HilSensors):
        vehicles = Vehicles(Airframe(), [[3.0, 5.0, 0.0]], np.pi / 2)  # nose north
        frame = LocalFrame(np.zeros(3), 0.0, GeoReference())
        binary = stand_in("px4")

        def program(i):
            parameters = px4_parameters(Airframe()) | {"COM_OF_LOSS_T": 2.0}
            return Px4Sitl(binary, tmp_path / "d", 4, parameters, kind(frame, (1, i)), 0.01)

        running.append(LockstepFleet(vehicles, program, [0.01]))
        return running[-1]

    yield boot
    for f in running:
        f.close()


def arm(fleet):
    """Ask to arm by the companion's link; whether motors were commanded within 2 s."""
    fleet.pass_on(0, "companion", ARM.pack(mavlink.MAVLink(None, 4, 191)))
    for k in range(100):
        fleet.advance(fleet.t + 0.02)
        fleet.packets(0, "companion")
        if fleet.armed[0] and k > 60:
            return True
    return False


def test_it_arms_and_its_motors_have_their_order(fleet, tmp_path):
    f = fleet()
    assert f.clock_ms[0] % 100 == 10  # a whole period of the cameras, and its own phase
    assert arm(f)
    # rear right, front right, rear left, front left
    np.testing.assert_allclose(f._sitls[0].command, [0.5, 0.2, 0.3, 0.4], atol=1e-6)
    seen = json.loads((tmp_path / "d" / "seen.json").read_text())
    assert seen["HIL_SENSOR"]["zacc"] == pytest.approx(-9.8, abs=0.15)
    assert seen["HIL_SENSOR"]["xmag"] == pytest.approx(0.21, abs=0.02)  # north
    assert seen["HIL_GPS"]["lat"] > round(GeoReference().latitude_deg * 1e7)
    assert seen["HIL_GPS"]["eph"] < 10  # cm


def test_a_vehicle_whose_sensors_repeat_themselves_is_never_armed(fleet):
    f = fleet(Noiseless)
    assert not f._said[0].armable
    assert not arm(f)


def test_it_boots_with_the_parameters_of_its_airframe(fleet, tmp_path):
    fleet()
    text = json.loads((tmp_path / "d" / "environment.json").read_text())
    told = {k.removeprefix("PX4_PARAM_"): float(v) for k, v in text.items() if "PARAM" in k}
    assert told["MAV_SYS_ID"] == 4
    assert told["COM_OF_LOSS_T"] == 2.0
    assert told["THR_MDL_FAC"] == 1.0  # force ∝ command²
    assert told["MPC_THR_HOVER"] == pytest.approx(0.7 * 9.80665 / (4 * 5.15), abs=1e-3)
    # rotors: front right, rear left, front left, rear right; x forward, y right
    places = [(told[f"CA_ROTOR{k}_PX"], told[f"CA_ROTOR{k}_PY"]) for k in range(4)]
    assert np.sign(places).tolist() == [[1, 1], [-1, -1], [1, -1], [-1, 1]]
    assert [np.sign(told[f"CA_ROTOR{k}_KM"]) for k in range(4)] == [1, 1, -1, -1]


def test_the_accelerometer_feels_a_touchdown_between_two_samples():
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0012]], 0.0)
    vehicles.state.v[0] = [0.0, 0.0, -0.5]
    sensors = HilSensors(LocalFrame(np.zeros(3), 0.0, GeoReference()), (7,))
    samples = []
    for k in range(4):  # on the ground in the third millisecond of the second sample
        samples.append(sensors.imu(0.004 * k, 0, vehicles.state))
        vehicles.step(0.004, np.zeros((1, 4)), n_substeps=4)
    assert vehicles.state.contact[0]
    gained = sum(s.force[2] - 9.80665 for s in samples[1:]) * 0.004
    assert gained == pytest.approx(0.5, abs=0.01)


def test_noise_is_that_of_the_data_sheets():
    frame = LocalFrame(np.zeros(3), 0.0, GeoReference())
    sensors, state = HilSensors(frame, (7,)), Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0).state
    imu = [sensors.imu(0.0, 0, state) for _ in range(4000)]
    gps = [sensors.gps(0.0, 0, state) for _ in range(4000)]
    north = np.array([(g.latitude_deg - GeoReference().latitude_deg) * 111.2e3 for g in gps])
    assert np.std([s.omega for s in imu]) == pytest.approx(np.radians(0.157), rel=0.05)
    # about the specific force at rest, 9.81 m/s² along z
    assert np.std([s.force - [0, 0, 9.80665] for s in imu]) == pytest.approx(0.0192, rel=0.05)
    assert np.std([s.pressure for s in imu]) == pytest.approx(0.012, rel=0.05)
    assert np.std(north) == pytest.approx(0.0085, rel=0.1)
    assert np.std([g.v for g in gps]) == pytest.approx(0.0425, rel=0.05)


def test_an_instance_that_runs_in_another_namespace_is_passed_over(tmp_path, monkeypatch):
    """Its ports are free here; PX4 then says `PX4 server already running` and ends."""
    monkeypatch.setattr(px4_hil, "_LOCK", str(tmp_path / "px4_lock"))
    listener, free = px4_hil._first_free()
    listener.close()
    (tmp_path / f"px4_lock-{free}").touch()
    listener, again = px4_hil._first_free()
    listener.close()
    assert again == free  # a file that nobody locks
    script = (
        "import fcntl, sys; f = open(sys.argv[1], 'r+b'); fcntl.lockf(f, fcntl.LOCK_EX);"
        "print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", script, str(tmp_path / f"px4_lock-{free}")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        listener, another = px4_hil._first_free()
        listener.close()
        other.stdin.close()
    assert another > free
