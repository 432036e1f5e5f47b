"""Probes of a PX4 on the ground, which the emulated one passes, too; skipped without a vehicle.

UNDER_TEST names the link of a real PX4 (SITL on its onboard port, or a drone without propellers):
it is armed for a moment. Without it the emulated PX4 stands in.
"""

import pytest

from mavlink_bridge.wire.messages import (
    CommandAck,
    Event,
    Heartbeat,
    MissionCount,
    MissionRequest,
    ParamError,
    ParamRequestRead,
    ParamSet,
    StatusText,
)
from tests.wire.vehicles_under_test import command, results, under_test

OFFBOARD, HOLD, LAND = (1.0, 6.0, 0.0), (1.0, 4.0, 3.0), (1.0, 4.0, 6.0)


@pytest.fixture(params=["emulated", "real"])
def px4(request):
    vehicle = under_test(request.param, "px4")
    vehicle.ask(command(vehicle, 176, *HOLD), 1.5)
    yield vehicle
    vehicle.ask(command(vehicle, 400, 0.0), 1.5)
    vehicle.ask(command(vehicle, 176, *HOLD), 1.5)
    vehicle.close()


def test_modes_are_acknowledged_on_arrival_and_with_their_result(px4):
    assert results(px4, 176, *OFFBOARD) == [0, 0]
    assert results(px4, 176, 1.0, 99.0, 99.0) == [0, 1]


def test_it_shows_offboard_without_a_stream_and_does_not_arm_in_it(px4):
    heard = px4.ask(command(px4, 176, *OFFBOARD), 2.5)
    beats = [m for m in heard if isinstance(m, Heartbeat)]
    assert (beats[-1].custom_mode, beats[-1].system_status) == (0x00060000, 0)
    heard = px4.ask(command(px4, 400, 1.0), 1.0)
    assert [m.result for m in heard if isinstance(m, CommandAck)] == [1]
    assert 0x0102089D in [m.event_id for m in heard if isinstance(m, Event)]
    assert not [m for m in heard if isinstance(m, StatusText)]  # words are for ground stations


def test_its_checks_are_reported_on_request(px4):
    heard = px4.ask(command(px4, 401), 1.5)
    told = {m.event_id: m for m in heard if isinstance(m, Event)}
    assert 0x01A893E0 in told  # the summary
    assert told[0x012F1DC7].arguments[:4] == bytes([0, 0x40, 0, 0])  # no offboard signal


def test_it_arms_from_hold(px4):
    assert results(px4, 176, *OFFBOARD)[-1] == 0
    assert results(px4, 176, *HOLD)[-1] == 0
    assert results(px4, 400, 1.0) == [0]
    assert results(px4, 176, *OFFBOARD) == [0, 1]  # armed, and no stream
    assert results(px4, 400, 0.0) == [0]
    assert results(px4, 176, *LAND) == [0, 0]
    assert results(px4, 400, 1.0) == [1]


def test_wrong_parameters_are_errors(px4):
    for ask, error in (
        (ParamRequestRead(px4.system, 1, "NO_SUCH", -1), 1),
        (ParamSet(px4.system, 1, "NO_SUCH", 1.0, 9), 1),
        (ParamSet(px4.system, 1, "COM_OBL_RC_ACT", 4.0, 9), 7),
    ):
        assert [m.error for m in px4.ask(ask, 0.8) if isinstance(m, ParamError)] == [error]


def test_it_asks_again_for_a_mission_item(px4):
    heard = px4.ask(MissionCount(px4.system, 1, 2), 2.0)
    asked = [m for m in heard if isinstance(m, MissionRequest)]
    assert 6 <= len(asked) <= 9
    assert {m.seq for m in asked} == {0}
    px4.ask(command(px4, 401), 6.0)  # it gives up after five seconds
