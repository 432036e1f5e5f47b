"""A Betaflight process that is slow to start; sockets stand in for it."""

import math
import socket
import struct
import threading

import numpy as np
import pytest

from mavlink_bridge.betaflight.msp import Msp, encode
from mavlink_bridge.shared.frames import (
    euler_from_quaternion,
    multiply,
    quaternion_from_euler,
)
from sitl_sim.external.betaflight_link import simulator_link
from sitl_sim.external.betaflight_relay import Relay
from sitl_sim.external.betaflight_sitl import BetaflightError, BetaflightSitl, _api_version
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

READY = bytes(6 + 9) + bytes([0]) + bytes(7)  # STATUS_EX: no reason against arming
OLDER, NEWER = (1, 47), (1, 49)  # MSP API of Betaflight 4.6 and of 2026.12


def answer(payload, command=Msp.STATUS_EX):
    """A message as the controller sends it."""
    query = encode(command, payload)
    return query[:2] + b">" + query[3:]


def boots(serve):
    """Whether a process with this behaviour counts as booted."""
    ours, theirs = socket.socketpair()
    sitl = BetaflightSitl.__new__(BetaflightSitl)
    sitl._connect = lambda: ours
    thread = threading.Thread(target=serve, args=(theirs,))
    thread.start()
    try:
        return sitl._boots()
    finally:
        thread.join()
        theirs.close()


def crash(line):
    line.recv(1000)
    line.close()


def starve(line):
    """Answer without a payload, as a dropped task does, then with a whole one."""
    for payload in (b"", b"", READY):
        line.recv(1000)
        line.sendall(answer(payload))


@pytest.mark.parametrize(("serve", "booted"), [(crash, False), (starve, True)])
def test_a_process_that_starts_badly_is_asked_again_or_abandoned(serve, booted):
    assert boots(serve) is booted


def version_told_by(serve):
    """The MSP API of a process with this behaviour."""
    ours, theirs = socket.socketpair()
    thread = threading.Thread(target=serve, args=(theirs,))
    thread.start()
    try:
        return _api_version(ours)
    finally:
        thread.join()
        ours.close()
        theirs.close()


def test_the_version_is_asked_again_where_a_dropped_task_answers_without_a_payload():
    def starve(line):
        for payload in (b"", b"", bytes([0, 1, 49])):
            line.recv(1000)
            line.sendall(answer(payload, Msp.API_VERSION))

    assert version_told_by(starve) == NEWER


def test_a_process_that_hangs_up_tells_no_version():
    with pytest.raises(BetaflightError, match="hung up"):
        version_told_by(crash)


def motion(api):
    """The packet of a vehicle that leans right, faces north-west, turns, climbs: as numbers."""
    vehicle = Vehicles([Airframe()], np.array([[0.0, 0.0, 12.0]]), [3 * math.pi / 4])
    vehicle.state.q[0] = multiply(vehicle.state.q[0], quaternion_from_euler(0.3, 0.0, 0.0))
    vehicle.state.omega[0] = [0.1, 0.2, 0.3]
    vehicle.state.specific_force[0] = [1.0, 2.0, 9.0]
    vehicle.state.v[0] = [4.0, 5.0, 6.0]
    frame = LocalFrame(np.zeros(3), 0.0, GeoReference())
    packet = struct.unpack("<18d", simulator_link(api).motion_packet(0, vehicle.state, frame))
    assert packet[0] == 0.0
    fields = {"omega": packet[1:4], "force": packet[4:7], "q": packet[7:11]}
    return fields | {"v": packet[11:14], "place": packet[14:17], "pressure": packet[17]}


@pytest.mark.parametrize("api", [OLDER, NEWER])
def test_velocity_comes_before_the_place_in_the_packet(api):
    m = motion(api)
    assert m["v"] == (4.0, 5.0, 6.0)
    longitude, latitude, altitude = m["place"]
    assert (longitude, latitude) == pytest.approx((8.545594, 47.397742))
    assert altitude == pytest.approx(500.0)  # the newer Betaflight's barometer reads this
    assert m["pressure"] == pytest.approx(101325.0 * (1.0 - 2.25577e-5 * 500.0) ** 5.25588)


@pytest.mark.parametrize(
    ("api", "yaw", "order"), [(OLDER, -0.3, (3, 0, 1, 2)), (NEWER, 0.3, (0, 1, 2, 3))]
)
def test_yaw_rate_and_motor_order_are_those_of_the_version(api, yaw, order):
    assert motion(api)["omega"] == pytest.approx((0.1, -0.2, yaw))
    assert simulator_link(api).motor_order == order


def test_the_attitude_is_in_the_frame_of_the_version():
    """Both say: right wing down by 0.3 rad, nose to the north-west."""
    roll, pitch, yaw = euler_from_quaternion(motion(OLDER)["q"])  # FRD to NED
    assert (roll, pitch, yaw) == pytest.approx((0.3, 0.0, -math.pi / 4), abs=1e-9)
    w, x, y, z = motion(NEWER)["q"]
    # As sitl.c undoes it: the other half turn, then what it takes for ENU to NWU.
    quarter = quaternion_from_euler(0.0, 0.0, math.pi / 2)
    undone = multiply(quarter, np.array([w, x, -y, -z]))
    roll, pitch, yaw = euler_from_quaternion(undone)
    assert (roll, pitch, yaw) == pytest.approx((0.3, 0.0, math.pi / 4), abs=1e-9)


def test_the_newer_one_takes_sticks_from_the_bridge_and_no_position_of_its_own():
    lines = set(simulator_link(NEWER).settings)
    assert lines >= {"feature -GPS", "feature -RX_UDP", "feature RX_MSP"}
    assert not simulator_link(OLDER).settings


@pytest.mark.parametrize("callers", [0, 2])
def test_a_relay_that_is_closed_leaves_nothing_behind(callers):
    before = set(threading.enumerate())
    process = socket.create_server(("127.0.0.1", 0))
    relay = Relay(lambda: socket.create_connection(process.getsockname()))
    port = relay.port
    lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(callers)]
    for line in lines:
        line.sendall(b"x")
    far_ends = [process.accept()[0] for _ in range(callers)]
    assert [far.recv(1) for far in far_ends] == [b"x"] * callers
    relay.close()
    assert set(threading.enumerate()) == before
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), 1.0)
    for end in lines + far_ends:
        assert end.recv(1) == b""
        end.close()
    process.close()
