"""A Betaflight process that is slow to start; sockets stand in for it."""

import socket
import threading

import pytest

from mavlink_bridge.betaflight.msp import Msp, encode
from sitl_sim.external.betaflight_sitl import BetaflightError, BetaflightSitl, Relay

READY = bytes(6 + 9) + bytes([0]) + bytes(7)  # STATUS_EX: no reason against arming
API = bytes([0, 1, 47])  # API_VERSION of Betaflight 4.6


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
        line.sendall(answer(payload) + answer(API if payload else b"", Msp.API_VERSION))
    line.recv(1000)
    line.sendall(answer(READY))


def newer(line):
    """Answer as a Betaflight whose simulator link differs."""
    line.recv(1000)
    line.sendall(answer(bytes([0, 1, 48]), Msp.API_VERSION))


@pytest.mark.parametrize(("serve", "booted"), [(crash, False), (starve, True)])
def test_a_process_that_starts_badly_is_asked_again_or_abandoned(serve, booted):
    assert boots(serve) is booted


def test_a_betaflight_with_another_simulator_link_is_refused():
    with pytest.raises(BetaflightError, match=r"MSP API 1\.48: .* up to 1\.47"):
        boots(newer)


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
