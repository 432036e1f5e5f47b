"""Check of the vehicle against the config, and the requests of each adapter."""

import math

import pytest

from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.autopilots.registry import ADAPTERS, Identity, adapter
from mavlink_bridge.wire.messages import AutopilotVersion, Heartbeat, ParamValue


def beat(autopilot, custom_mode=0):
    return Heartbeat(autopilot, 2, False, custom_mode, 3)


def options(value):
    return ParamValue("GUID_OPTIONS", value, 6, 20, 3)


@pytest.mark.parametrize(
    ("name", "received", "words"),
    [
        ("px4", [beat(12)], ""),
        (
            "px4",
            [beat(3), AutopilotVersion(0, 0x040700FF, 1)],
            "vehicle 7 is ardupilot 4.7.0, but link.autopilot: px4; valid: px4, ardupilot, beta",
        ),
        ("ardupilot", [beat(12)], "vehicle 7 is px4, but link.autopilot: ardupilot"),
        ("ardupilot", [beat(4)], "vehicle 7 is unknown (MAV_AUTOPILOT 4)"),
        ("ardupilot", [beat(3)], "waiting for parameter GUID_OPTIONS"),
        (
            "ardupilot",
            [beat(3), options(0.0)],
            "GUID_OPTIONS is 0: thrust would be taken as a climb rate; set GUID_OPTIONS to 8",
        ),
        ("ardupilot", [beat(3), options(1.0)], "set GUID_OPTIONS to 9 (bit 3)"),
        ("ardupilot", [beat(3), options(9.0)], ""),
        ("ardupilot", [beat(3), options(math.nan)], "waiting for parameter GUID_OPTIONS"),
        ("ardupilot", [beat(3), options(8.0), options(-math.inf)], ""),
        ("betaflight", [beat(0, 101)], ""),
        ("betaflight", [beat(0, 1)], "takes no setpoints; start mavlink-bridge betaflight"),
        ("px4", [], ""),
    ],
)
def test_a_vehicle_that_must_not_fly_is_reported_in_one_line(name, received, words):
    identity = Identity(name, 7)
    identity.hear(received)
    assert words in identity.inhibit_reason() if words else identity.inhibit_reason() == ""
    assert "\n" not in identity.inhibit_reason()


@pytest.mark.parametrize("name", sorted(ADAPTERS))
def test_every_adapter_addresses_its_vehicle(name):
    a = adapter(name, 3)
    requests = [*a.request_streams(), *a.arm(), *a.takeoff(2.0)]
    requests += [*a.offboard(), *a.hold(), *a.land()]
    assert {m.target_system for m in requests} == {3}
    assert a.mode(beat(a.autopilot, 0x7FFF)) == "other"
    assert a.mode_after_takeoff in ("hold", "offboard")


def test_the_mode_is_read_from_heartbeat():
    assert adapter("px4", 1).mode(beat(12, MODES["offboard"])) == "offboard"
    assert adapter("ardupilot", 1).mode(beat(3, 4)) == "offboard"
    assert adapter("ardupilot", 1).mode(beat(3, 20)) == "offboard"
    assert adapter("betaflight", 1).mode(beat(0, 104)) == "offboard"
