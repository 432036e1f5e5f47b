"""An ArduCopter on the simulator's physics; the stand-in parses as SIM_JSON.cpp does."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from sitl_sim.external import ardupilot_json
from sitl_sim.external.airframe_parameters import ardupilot_parameters
from sitl_sim.external.ardupilot_json import ArdupilotSitl, motion_line
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

FRAME = LocalFrame(np.zeros(3), 0.0, GeoReference())
_spec = importlib.util.spec_from_file_location(
    "stand_in_ardupilot", Path(__file__).parent / "stand_ins" / "ardupilot.py"
)
STAND_IN = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(STAND_IN)


def moving():
    """A vehicle with its nose to the north, of which every number differs."""
    vehicles = Vehicles(Airframe(), [[3.0, 5.0, 1.0]], np.pi / 2)
    vehicles.state.v[0] = [1e-7, 2.0, 3.0]
    vehicles.state.omega[0] = [0.1, 0.2, 0.3]
    vehicles.state.specific_force[0] = [0.0, 0.5, 9.8]
    return vehicles


def test_its_parser_takes_our_line():
    line = motion_line(0.001, 0, moving().state, FRAME).decode()
    assert line[0] == line[-1] == "\n"
    read = STAND_IN.parse(line.strip("\n"))
    assert read["timestamp"] == pytest.approx([0.001])
    assert read["position"] == pytest.approx([5.0, 3.0, -1.0])  # north, east, down
    assert read["velocity"] == pytest.approx([2.0, 1e-7, -3.0])
    assert read["gyro"] == pytest.approx([0.1, -0.2, -0.3])
    assert read["accel_body"] == pytest.approx([0.0, -0.5, -9.8])
    assert np.abs(read["quaternion"]) == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
    assert read["no_time_sync"] == [1.0]  # `true` would be read as 0


@pytest.mark.parametrize(("tight", "loose"), [('"gyro":[', '"gyro": ['), (":[0.1,", ":[0.1 ,")])
def test_its_parser_refuses_a_blank(tight, loose):
    line = motion_line(0.001, 0, moving().state, FRAME).decode()
    assert tight in line
    assert STAND_IN.parse(line.replace(tight, loose)) is None


def test_its_clock_loses_nothing_in_a_long_flight():
    state, clock_us, before = moving().state, 0, 0.0
    for k in range(1, 20_001):
        line = motion_line(0.05 + k * 0.001, 0, state, FRAME)
        stamp = float(line.split(b'"timestamp":')[1].split(b",")[0])
        clock_us, before = STAND_IN.ticked(clock_us, before, stamp), stamp
    assert clock_us == 50_000 + 20_000_000


def test_its_clock_is_the_fleets(tmp_path, stand_in):
    binary = stand_in("ardupilot", motors=(0.8, 0.8, 0.8, 0.8))
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0)

    def program(i):
        parameters = ardupilot_parameters(Airframe()) | {"GUID_OPTIONS": 8.0}
        return ArdupilotSitl(binary, tmp_path / "d", 3, parameters, FRAME, 0.05)

    fleet = LockstepFleet(vehicles, program, [0.05])
    try:
        assert fleet._said[0].armable
        low = vehicles.p[0, 2]
        fleet.advance(1.0)
        assert vehicles.p[0, 2] > low + 2.0  # its PWM of 1800 µs
        np.testing.assert_allclose(fleet._sitls[0].command, 0.8)
        seen = json.loads((tmp_path / "d" / "seen.json").read_text())
        assert seen["clock"] == pytest.approx(fleet.clock_ms[0] / 1e3, abs=0.021)
        assert seen["timestamp"][0] == pytest.approx(seen["clock"])  # they began at 0
    finally:
        fleet.close()
    assert not (tmp_path / "d" / "refused.json").exists()
    given = json.loads((tmp_path / "d" / "arguments.json").read_text())
    assert given[given.index("--sysid") + 1] == "3"
    text = (tmp_path / "d" / "defaults.parm").read_text()
    parameters = dict(line.split() for line in text.splitlines())
    assert parameters["GUID_OPTIONS"] == "8"
    assert (parameters["FRAME_CLASS"], parameters["FRAME_TYPE"]) == ("1", "1")
    assert parameters["MOT_THST_EXPO"] == "1"
    # (√(m g / F) − idle)² / (1 − idle)², and the density at 488 m
    assert float(parameters["MOT_THST_HOVER"]) == pytest.approx(0.2913, abs=1e-3)


def test_a_packet_sent_twice_is_one_step():
    sitl = ArdupilotSitl.__new__(ArdupilotSitl)
    sitl._socket, instance = ardupilot_json._first_free()
    sitl._frame_number, sitl._peer = -1, None
    import socket

    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        for number, us in ((5, 1200), (5, 1200), (6, 1300)):
            packet = ardupilot_json._PWM.pack(18458, 1200, number, *[us] * 16)
            sender.sendto(packet, ("127.0.0.1", 9002 + 10 * instance))
        assert sitl.receive(1.0)
        np.testing.assert_allclose(sitl.command, 0.2)
        assert sitl.receive(1.0)
        np.testing.assert_allclose(sitl.command, 0.3)
        assert not sitl.receive(0.0)
    finally:
        sender.close()
        sitl._socket.close()
