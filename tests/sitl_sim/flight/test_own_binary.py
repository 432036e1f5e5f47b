"""A user's own ArduPilot or PX4 by path: stand-ins implement their simulator links."""

import json
import sys
import time

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.external.ardupilot_json import ArdupilotSitl
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.fleet import RealFleet, Wire
from sitl_sim.external.px4_hil import Px4Sitl
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

INSTANCE = 7  # UDP 9072, TCP 4567
# Front right, rear left, front left, rear right.
ARDUPILOT = """
import json, socket, struct, sys
n = int(sys.argv[sys.argv.index("-I") + 1])
motors = json.load(open("../motors.json"))
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(0.05)
json.dump(sys.argv[1:], open("arguments.json", "w"))
k = 0
while True:
    k += 1
    pwm = [1000 + round(1000 * m) for m in motors] + [1500] * 12
    s.sendto(struct.pack("<HHI16H", 18458, 400, k, *pwm), ("127.0.0.1", 9002 + 10 * n))
    try:
        line = s.recv(2000)
    except TimeoutError:
        continue
    if k % 20 == 0:
        open("seen.part", "wb").write(line)
        import os; os.replace("seen.part", "seen.json")
"""
PX4 = """
import json, os, socket, sys
from pymavlink.dialects.v20 import common as mavlink
n = int(sys.argv[sys.argv.index("-i") + 1])
motors = json.load(open("../motors.json"))
s = socket.create_connection(("127.0.0.1", 4560 + n))
mav, seen = mavlink.MAVLink(None, 1, 1), {}
mav.robust_parsing = True
while True:
    for m in mav.parse_buffer(s.recv(4096)) or []:
        seen[m.get_type()] = m.to_dict()
        if m.get_type() == "HIL_SENSOR":
            answer = mavlink.MAVLink_hil_actuator_controls_message(
                m.time_usec, motors + [0.0] * 12, 128, 0)
            s.sendall(answer.pack(mav))
    if len(seen) == 2 and not os.path.exists("seen.json"):
        seen["system"] = os.environ["PX4_PARAM_MAV_SYS_ID"]
        json.dump(seen, open("seen.part", "w"))
        os.replace("seen.part", "seen.json")
"""


def stand_in(folder, text, motors):
    """An executable that plays the autopilot with constant motor commands."""
    (folder / "motors.json").write_text(json.dumps(motors))
    binary = folder / "autopilot"
    binary.write_text(f"#!{sys.executable}\n{text}")
    binary.chmod(0o755)
    return str(binary)


def ardupilot(folder, motors):
    binary = stand_in(folder, ARDUPILOT, motors)
    wires = "127.0.0.1:14541", "127.0.0.1:14550"
    return ArdupilotSitl(binary, folder / "d", INSTANCE, 4, *wires, {"A": 2.5}, GeoReference())


def px4(folder, motors):
    return Px4Sitl(stand_in(folder, PX4, motors), folder / "d", INSTANCE, 4, {})


@pytest.mark.parametrize("make", [ardupilot, px4])
def test_motors_have_their_order_and_motion_its_frames(tmp_path, make):
    sitl = make(tmp_path, [0.2, 0.3, 0.4, 0.5])
    try:
        vehicles = Vehicles(Airframe(), [[3.0, 5.0, 0.0]], np.pi / 2)  # nose north
        vehicles.state.omega[0] = [0.1, 0.2, 0.3]
        vehicles.state.specific_force[0] = [0.0, 0.5, 9.8]
        frame = LocalFrame(np.zeros(3), 0.0, GeoReference())
        end = time.monotonic() + 20.0
        seen = tmp_path / "d" / "seen.json"
        while time.monotonic() < end and not (seen.exists() and sitl.command.any()):
            sitl.exchange(0, vehicles.state, frame)
            time.sleep(0.002)
        # rear right, front right, rear left, front left
        np.testing.assert_allclose(sitl.command, [0.5, 0.2, 0.3, 0.4], atol=1e-6)
    finally:
        sitl.close()
    seen = json.loads(seen.read_text())
    if make is ardupilot:
        assert seen["position"] == pytest.approx([5.0, 3.0, 0.0])  # north, east, down
        assert seen["imu"]["gyro"] == pytest.approx([0.1, -0.2, -0.3])
        assert seen["imu"]["accel_body"] == pytest.approx([0.0, -0.5, -9.8])
        assert np.abs(seen["quaternion"]) == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
        arguments = json.loads((tmp_path / "d" / "arguments.json").read_text())
        assert arguments[arguments.index("--serial0") + 1] == "udpclient:127.0.0.1:14541"
        assert "A 2.5\n" in (tmp_path / "d" / "defaults.parm").read_text()
    else:
        sensor, gps = seen["HIL_SENSOR"], seen["HIL_GPS"]
        assert (sensor["xgyro"], sensor["zacc"]) == (pytest.approx(0.1), pytest.approx(-9.8))
        assert sensor["xmag"] == pytest.approx(0.21, abs=1e-3)  # north
        assert gps["lat"] > round(GeoReference().latitude_deg * 1e7)
        assert seen["system"] == "4"


def test_a_fleet_of_users_binaries_flies_the_physics(tmp_path):
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0)
    fleet = RealFleet(
        vehicles,
        [1],
        [tmp_path],
        [Wire("127.0.0.1", 1, 1)],
        origin=np.zeros((1, 3)),
        yaw_offset=np.zeros(1),
        program=lambda i: ardupilot(tmp_path, [0.8] * 4),
    )
    try:
        fleet.begin(time.monotonic())
        fleet.advance(0.4)
        low = fleet.vehicles.p[0, 2]
        fleet.advance(0.8)
        assert fleet.vehicles.p[0, 2] > low + 0.5
        assert fleet.armed[0]
        fleet._sitls[0]._process.kill()
        fleet._sitls[0]._process.wait()
        with pytest.raises(ExternalError, match="autopilot or bridge of vehicle 1 ended"):
            fleet.advance(1.0)
    finally:
        fleet.close()


def test_a_program_that_is_no_autopilot_is_one_clear_line(tmp_path):
    script = tmp_path / "ends"
    script.write_text("#!/bin/sh\n")
    with pytest.raises(ExternalError, match="ends: cannot be run: Permission denied"):
        Px4Sitl(str(script), tmp_path / "a", INSTANCE, 1, {})
    script.chmod(0o755)
    sitl = Px4Sitl(str(script), tmp_path / "a", INSTANCE, 1, {})
    try:
        with pytest.raises(ExternalError, match=r"ends ended; see .*output.log"):
            sitl.await_boot()
        with pytest.raises(ExternalError, match=f"TCP {4560 + INSTANCE}: Address already in use"):
            Px4Sitl(str(script), tmp_path / "b", INSTANCE, 1, {})
    finally:
        sitl.close()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["drones.binary=/nowhere/px4"], "drones.binary: /nowhere/px4: no such file"),
        (["drones.binary=/bin/true", "drones.autopilot=betaflight"], "for px4 and ardupilot"),
        (["drones.binary=/bin/true", "wire.companion_port=21000"], "PX4 sends to 14540"),
        (["drones.binary=/bin/true", "drones.count=10"], "nine fly at most"),
    ],
)
def test_a_scenario_that_cannot_have_a_binary_is_refused(tmp_path, capsys, settings, words):
    more = [part for s in settings for part in ("--set", s)]
    run = ["run", "forest", "--set", "drones.count=1", "--out", str(tmp_path / "run"), *more]
    assert main(run) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert words in lines[0]
