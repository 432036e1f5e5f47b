"""Clients of other projects, unmodified from PyPI, fly the emulated vehicles in real time.

What they measure does not depend on how loaded the machine is; only their patience is in wall
time. The scripts in `clients/` are what a user would write.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.wire.served import free_ports, served

CLIENTS = Path(__file__).parent / "clients"
PARAMETERS = {"px4": (33, 4, 5), "ardupilot": (22, 8, 8)}  # how many, one of them before and after


def client(name, *arguments, timeout=240):
    """Run a client's script; return the JSON objects that it printed."""
    done = subprocess.run(
        [sys.executable, str(CLIENTS / name), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def check_flight(flown, flavour):
    """Check the measurements of a flight by MAVSDK."""
    assert flown["health"] == 7
    assert (flown["parameters"], flown["int_before"], flown["int_after"]) == PARAMETERS[flavour]
    assert flown["hover"] == pytest.approx(0.333)
    assert flown["takeoff_height"] == pytest.approx(5.0, abs=0.3)
    assert flown["offboard_active"]
    assert "OFFBOARD" in flown["modes"], flown
    assert flown["height_span"] < 1.0
    assert flown["landed_height"] == pytest.approx(0.0, abs=0.2)
    # 20°/s for ten seconds; a starved client stops a little early or late.
    assert flown["turned"] == pytest.approx(200.0, rel=0.15)


def test_mavsdk_flies_px4():
    with served("px4") as world:
        (flown,) = client("fly_mavsdk.py", "px4", "all", *world.urls(1))
    check_flight(flown, "px4")
    assert flown["float_after"] == 12.5
    assert flown["mission_items"] == 3
    assert max(flown["mission_nearest"]) < 1.5


@pytest.mark.slow
def test_mavsdk_flies_ardupilot():
    with served("ardupilot") as world:
        (flown,) = client("fly_mavsdk.py", "ardupilot", "all", *world.urls(1))
    check_flight(flown, "ardupilot")
    assert flown["mission_items"] == 4  # home first
    assert max(flown["mission_nearest"]) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_one_mavsdk_flies_ten_at_once(flavour):
    with served(flavour, 10) as world:
        flown = client("fly_mavsdk.py", flavour, "quick", *world.urls(10))
    assert {f["system"] for f in flown} == set(range(1, 11))
    for f in flown:
        check_flight(f, flavour)


@pytest.mark.slow
@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_mavsdk_grpc_flies(flavour):
    with served(flavour) as world:
        (flown,) = client("fly_grpc.py", flavour, free_ports(1), *world.urls(1))
    assert flown["takeoff_height"] == pytest.approx(5.0, abs=0.3)
    assert flown["offboard_active"]
    assert flown["disarmed"]
