"""Probes of an ArduCopter on the ground, which the emulated one passes, too; see test_real_px4.

UNDER_TEST names the link of a real one. It is armed for a moment.
"""

from dataclasses import replace

import pytest

from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    CommandAck,
    Heartbeat,
    MissionAck,
    MissionCount,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Ping,
    StatusText,
)
from tests.wire.vehicles_under_test import command, results, under_test

GUIDED, AUTO, BRAKE = 4.0, 3.0, 17.0


@pytest.fixture(params=["emulated", "real"])
def copter(request):
    vehicle = under_test(request.param, "ardupilot")
    assert results(vehicle, 176, 1.0, GUIDED) == [0]
    yield vehicle
    vehicle.ask(command(vehicle, 400, 0.0), 1.5)
    vehicle.close()


def ask_parameter(copter, message):
    return [m for m in copter.ask(message, 0.8) if isinstance(m, ParamValue)]


def test_a_mode_needs_the_custom_flag(copter):
    assert results(copter, 176, 0.0, BRAKE) == [2]
    assert results(copter, 176, 1.0, 99.0) == [4]
    heard = copter.ask(command(copter, 176, 1.0, BRAKE), 1.5)
    assert [m.custom_mode for m in heard if isinstance(m, Heartbeat)][-1] == int(BRAKE)


def test_it_says_in_which_mode_it_does_not_arm(copter):
    assert results(copter, 176, 1.0, AUTO) == [0]  # without a mission
    for mode, words in (
        (AUTO, "Arm: Mode requires mission"),
        (BRAKE, "Arm: BRAKE mode not armable"),
    ):
        assert results(copter, 176, 1.0, mode) == [0]
        heard = copter.ask(command(copter, 400, 1.0), 1.0)
        assert [m.result for m in heard if isinstance(m, CommandAck)] == [4]
        assert words in [m.text for m in heard if isinstance(m, StatusText)]
    assert results(copter, 400, 2.0) == [3]
    assert results(copter, 176, 1.0, GUIDED) == [0]
    heard = copter.ask(command(copter, 400, 1.0), 1.0)
    assert [m.text for m in heard if isinstance(m, StatusText)] == ["Arming motors"]


def test_it_answers_for_a_component_that_it_hears_on_no_other_link(copter):
    ask = replace(command(copter, 512, 148.0), target_component=154)
    assert [m for m in copter.ask(ask, 0.8) if isinstance(m, AutopilotVersion)]


def test_what_it_does_not_send(copter):
    for odometry_or_estimator in (331.0, 230.0):
        assert results(copter, 511, odometry_or_estimator, 1e5) == [2]
        assert results(copter, 512, odometry_or_estimator) == [4]
    assert not [m for m in copter.ask(Ping(1.0, 7, 0, 0), 0.8) if isinstance(m, Ping)]


def test_a_parameter_by_name_has_no_index_and_any_case(copter):
    for name in ("GUID_OPTIONS", "guid_options"):
        (told,) = ask_parameter(copter, ParamRequestRead(copter.system, 1, name, -1))
        assert (told.name, told.index) == (name, 0xFFFF)
    (told,) = ask_parameter(copter, ParamRequestRead(copter.system, 1, "", 0))
    assert told.index == 0
    assert ask_parameter(copter, ParamRequestRead(copter.system, 1, "NO_SUCH", -1)) == []


def test_a_parameter_is_cut_to_what_its_type_holds(copter):
    for value, held in ((300.0, 127.0), (-200.0, -128.0), (8.7, 8.0), (9.995, 10.0)):
        (told,) = ask_parameter(copter, ParamSet(copter.system, 1, "DISARM_DELAY", value, 2))
        assert told.value == held
    for bad in (float("nan"), float("inf")):
        assert ask_parameter(copter, ParamSet(copter.system, 1, "DISARM_DELAY", bad, 2)) == []


def item(copter, seq, frame=6):
    place = (47.397742, 8.545594, 5.0)
    return MissionItem(copter.system, 1, seq, frame, 16, 0, 1, (0.0, 0.0, 0.0, 0.0), *place, 0)


def answers(copter, message, seconds=0.8):
    kinds = MissionAck | MissionRequest
    return [m for m in copter.ask(message, seconds) if isinstance(m, kinds)]


def test_mission_items_out_of_turn_or_in_a_local_frame_are_refused(copter):
    (asked,) = answers(copter, MissionCount(copter.system, 1, 2))
    assert asked.floating  # the old MISSION_REQUEST
    assert [m.result for m in answers(copter, item(copter, 1)) if isinstance(m, MissionAck)] == [13]
    (asked,) = answers(copter, item(copter, 0))
    assert asked.seq == 1
    (ack,) = answers(copter, item(copter, 1, frame=1))
    assert ack.result == 2
    (ack,) = answers(copter, MissionRequestList(copter.system, 1, 255))
    assert ack.result == 3


def test_an_upload_that_stops_is_cancelled(copter):
    heard = answers(copter, MissionCount(copter.system, 1, 2), 11.0)
    assert {m.seq for m in heard if isinstance(m, MissionRequest)} == {0}
    assert 7 <= len(heard) <= 11
    assert [m.result for m in heard if isinstance(m, MissionAck)] == [15]
