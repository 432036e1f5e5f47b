"""What the doctor says a vehicle will do when its companion dies."""

import pytest

from companion.doctor.finding import Level
from companion.doctor.silence import examine_silence

PX4 = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 4.0, "COM_RC_IN_MODE": 1.0, "RTL_RETURN_ALT": 30.0}
COPTER = {"GUID_TIMEOUT": 0.5, "GUID_OPTIONS": 8.0, "FS_GCS_ENABLE": 0.0, "FS_OPTIONS": 16.0}


@pytest.mark.parametrize(
    ("changed", "ceiling", "level", "words"),
    [
        ({}, 5.0, Level.GREEN, "it lands where it is"),
        ({"COM_OBL_RC_ACT": 5}, 5.0, Level.AMBER, "it holds until"),
        ({"COM_OBL_RC_ACT": 3}, 50.0, Level.AMBER, "it returns, at up to 30 m above home"),
        ({"COM_OBL_RC_ACT": 3}, 5.0, Level.RED, "over the fence's 5 m"),
        (
            {"COM_OBL_RC_ACT": 0},  # PX4's default
            50.0,
            Level.AMBER,
            "COM_OBL_RC_ACT is 0: position mode for a pilot's sticks; without RC it returns",
        ),
        (
            {"COM_OBL_RC_ACT": 1, "COM_RC_IN_MODE": 4},
            50.0,
            Level.AMBER,
            "altitude mode for a pilot's sticks; manual control is off (COM_RC_IN_MODE 4)",
        ),
        ({"COM_OBL_RC_ACT": 7}, 50.0, Level.RED, "it falls"),
        ({"COM_OBL_RC_ACT": None}, 50.0, Level.AMBER, "COM_OBL_RC_ACT was not sent"),
    ],
)
def test_px4(changed, ceiling, level, words):
    time, action = examine_silence("px4", (PX4 | changed).get, ceiling)
    assert (time.name, time.level) == ("silence", Level.GREEN)
    assert action.level is level
    assert words in action.text
    assert bool(action.todo) is (level is not Level.GREEN)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "FS_GCS_ENABLE is 0: the loss of the ground station changes nothing"),
        ({"FS_GCS_ENABLE": 5}, "when the ground station is lost too, it lands (FS_GCS_ENABLE 5)"),
        ({"FS_OPTIONS": 4}, "stays in guided mode where RC is lost (FS_OPTIONS bit 2)"),
        ({"FS_GCS_ENABLE": None}, "FS_GCS_ENABLE was not sent"),
    ],
)
def test_ardupilot_stays_in_guided_mode(changed, words):
    time, action = examine_silence("ardupilot", (COPTER | changed).get, 5.0)
    assert time.level is Level.GREEN
    assert action.level is Level.AMBER
    assert "it levels, holds its height and drifts with the wind" in action.text
    assert words in action.text


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "level"),
    [
        ("px4", "COM_OF_LOSS_T", 1.5, Level.AMBER),
        ("px4", "COM_OF_LOSS_T", 2.5, Level.RED),
        ("ardupilot", "GUID_TIMEOUT", 0.5, Level.GREEN),
        ("ardupilot", "GUID_TIMEOUT", 0.8, Level.AMBER),
        ("ardupilot", "GUID_TIMEOUT", 3.0, Level.RED),  # its default
        ("px4", "COM_OF_LOSS_T", None, Level.AMBER),
    ],
)
def test_a_vehicle_that_flies_on_for_long(autopilot, name, value, level):
    values = (PX4 if autopilot == "px4" else COPTER) | {name: value}
    time, _ = examine_silence(autopilot, values.get, 5.0)
    assert time.level is level
    assert name in time.text
