"""Refusals in words: acknowledgements, parameter errors, PX4's events, on recorded frames."""

import pytest

from mavlink_bridge.autopilots.answers import Answers
from mavlink_bridge.autopilots.px4_events import event_number
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import CommandAck, Event, Heartbeat, ParamError

OFFBOARD, HOLD = Heartbeat(12, 2, False, 0x00060000, 0), Heartbeat(12, 2, False, 0x03040000, 3)


@pytest.fixture
def px4():
    answers, vehicle = Answers(adapter("px4", 6)), adapter("px4", 6)
    answers.ask([*vehicle.arm(), *vehicle.takeoff(2.0), *vehicle.offboard()])
    return answers


@pytest.mark.parametrize(
    ("name", "number"),
    [  # recorded from PX4 1.17
        ("commander_arm_denied_resolve_failures", 0x0102089D),
        ("check_modes_offboard_signal", 0x012F1DC7),
        ("commander_arming_check_summary", 0x01A893E0),
        ("commander_unsupported_main_mode", 0x012A3F67),
        ("check_rc_dl_no_dllink", 0x0167C97B),
    ],
)
def test_events_have_the_numbers_of_px4(name, number):
    assert event_number(name) == number


@pytest.mark.row("41")
def test_a_refusal_names_what_was_asked_and_the_result(px4):
    assert px4.refusals([CommandAck(400, 1, 6, 191)]) == ["arm: temporarily rejected"]
    assert px4.refusals([CommandAck(176, 1, 6, 191)]) == ["mode offboard: temporarily rejected"]
    assert px4.refusals([CommandAck(22, 2, 6, 191)]) == ["take-off: denied"]
    assert px4.refusals([CommandAck(22, 77, 6, 191)]) == ["take-off: result 77"]


def test_consent_and_answers_to_others_are_no_refusals(px4):
    others = [CommandAck(400, 1, 255, 190), CommandAck(511, 3, 6, 191)]
    assert px4.refusals([CommandAck(400, 0, 6, 191), CommandAck(22, 5, 6, 191), *others]) == []


def test_a_parameter_error_is_told(px4):
    errors = [ParamError(6, 191, "MIS_TAKEOFF_ALT", -1, 7), ParamError(6, 191, "", 30, 1)]
    assert px4.refusals(errors) == [
        "parameter MIS_TAKEOFF_ALT: type mismatch",
        "parameter 30: does not exist",
    ]


def check(name, modes):
    return Event(1.0, event_number(name), 1, 3, modes.to_bytes(4, "little").ljust(40, b"\0"))


@pytest.mark.row("41")
def test_a_denied_arming_names_the_checks_that_fail_in_this_mode(px4):
    """PX4 reports its checks when they change, and only the fact when it denies."""
    summary = Event(1.0, 0x01A893E0, 1, 8, bytes(40))
    denied = Event(2.0, 0x0102089D, 9, 2, bytes(40))
    found = [summary, check("check_modes_offboard_signal", 0x4000), check("check_modes_mission", 8)]
    assert px4.refusals([OFFBOARD, *found]) == []
    assert px4.refusals([denied]) == ["arming denied: no setpoints for offboard"]
    assert px4.refusals([HOLD, denied]) == ["arming denied: a check fails"]
    px4.refusals([summary, check("check_gyro_missing", 0xFFFFFFFF)])
    assert px4.refusals([denied]) == ["arming denied: no gyro"]


def test_an_event_without_words_is_told_by_its_number_where_it_is_a_warning(px4):
    assert px4.refusals([Event(1.0, 0x01ABCDEF, 1, 4, bytes(40))]) == [
        "event 0x1abcdef, severity 4"
    ]
    assert px4.refusals([Event(1.0, 0x01ABCDEF, 1, 6, bytes(40))]) == []


def test_a_recorded_event_frame_of_px4_is_read():
    """EVENT as it came from PX4 1.17, zeros cut off at the end: id, time, sequence, level 0x62."""
    payload = bytes.fromhex("9d080201102700000700000062")
    frame = bytes([0xFD, len(payload), 0, 0, 1, 6, 1, 0x9A, 0x01, 0x00]) + payload
    crc = 0xFFFF
    for byte in (*frame[1:], 160):  # CRC-16/MCRF4XX, and MAVLink's CRC_EXTRA of EVENT
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    codec = Codec(1, 191)
    (received,) = codec.decode(frame + crc.to_bytes(2, "little"))
    assert received.message == Event(10.0, 0x0102089D, 7, 2, bytes(40))
    assert codec.statistics.bad_bytes == 0
