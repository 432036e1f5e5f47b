"""Setup of a flight controller: accepted, or refused with one clear line."""

import numpy as np
import pytest

from mavlink_bridge.betaflight.controller import QUESTIONS, query_controller
from mavlink_bridge.betaflight.msp import MspError
from tests.mavlink_bridge.betaflight.fake_controller import FakeController


def test_the_setup_of_a_controller_is_read():
    c = query_controller(FakeController().answer)
    assert (c.version, c.api, c.only_receiver, c.arm_bit) == ("4.6.0", (1, 47), True, 0)
    assert "Betaflight 4.6.0, MSP API 1.47" in c.report()


def test_channels_are_in_the_receivers_order():
    c = query_controller(FakeController().answer)
    channels = c.channels(np.array([0.2, -0.4, 1.0]), 0.5, armed=True, level=False)
    assert channels[:6] == [1600, 1300, 1500, 2000, 1900, 1000]  # A E T R AUX1 AUX2
    disarmed = c.channels(np.zeros(3), 0.0, armed=False, level=True)
    assert disarmed[:6] == [1500, 1500, 1000, 1500, 1000, 1900]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_give_valid_channels(bad):
    c = query_controller(FakeController().answer)
    for sticks, thrust in (([bad, 0.0, 0.0], 0.5), ([0.0, 0.0, 0.0], bad)):
        channels = c.channels(np.array(sticks), thrust, armed=True, level=False)
        assert all(1000 <= value <= 2000 for value in channels)
    channels = c.channels(np.full(3, np.nan), np.nan, armed=True, level=True)
    assert channels[:6] == [1500, 1500, 1000, 1500, 1900, 1900]


def test_body_rates_flu_give_stick_deflections():
    c = query_controller(FakeController().answer)
    sticks = c.rate_sticks(np.radians([40.0, 80.0, 120.0]))
    assert sticks == pytest.approx((0.1, 0.2, -0.3), abs=1e-4)  # turning left is stick left


def test_with_a_pilots_receiver_the_report_names_the_channel_mask():
    report = "\n".join(query_controller(FakeController(only_receiver=False).answer).report())
    assert "msp_override_channels_mask = 63" in report


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"variant": b"INAV"}, "flight controller runs 'INAV', not Betaflight ('BTFL')"),
        ({"api": (1, 41)}, "MSP API 1.41 is too old: needs 1.43 (Betaflight 4.2) or newer"),
        (
            {"features": 0},
            "no RC input for the bridge: neither feature RX_MSP nor a switch",
        ),
        ({"ranges": [(1, 1, 32, 48)]}, "no switch for mode ARM; CLI: aux 0 0 0 1700 2100 0 0"),
        ({"ranges": [(0, 0, 32, 48)]}, "no switch for mode ANGLE; CLI: aux 1 1 1 1700 2100 0 0"),
        (
            {"ranges": [(0, 0, 32, 48), (1, 0, 32, 48)]},
            "modes ARM and ANGLE are both on AUX1",
        ),
        (
            {"ranges": [(0, 0, 32, 48), (1, 1, 0, 48)]},
            "mode ANGLE cannot be switched off: AUX2 has it on from 900 to 2100 µs, 2000 µs",
        ),
        (
            {"ranges": [(0, 0, 32, 48), (1, 1, 32, 48), (1, 1, 0, 16)]},
            "mode ANGLE cannot be switched off: AUX2 has it on from 900 to 1300 µs, 1000 µs",
        ),
        (
            {"ranges": [(0, 0, 32, 48), (1, 1, 32, 48), (0, 5, 0, 48)]},
            "mode ARM cannot be switched off: AUX6 has it on from 900 to 2100 µs",
        ),
    ],
)
def test_a_controller_that_cannot_fly_is_refused_with_one_line(change, words):
    _refused(FakeController(), change, words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"boxes": [0, 1]},
            "mode MSP OVERRIDE has a switch but is not available (MSP_BOXIDS)",
        ),
        (
            {"api": (1, 47)},
            "MSP API 1.47 disarms when MSP OVERRIDE hands over and holds its",
        ),
    ],
)
def test_a_pilot_must_be_able_to_hand_over_and_take_back(change, words):
    _refused(FakeController(only_receiver=False), change, words)


def test_an_older_api_is_accepted_where_the_bridge_is_the_only_receiver():
    fake = FakeController()
    fake.api = (1, 46)
    assert query_controller(fake.answer).only_receiver


def _refused(fake, change, words):
    for name, value in change.items():
        setattr(fake, name, value)
    with pytest.raises(MspError) as error:
        query_controller(fake.answer)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("short", QUESTIONS)
def test_an_answer_cut_short_is_refused_with_one_line(short):
    with pytest.raises(MspError) as error:
        query_controller(lambda q: b"" if q == short else FakeController().answer(q))
    assert "\n" not in str(error.value)


def test_a_silent_controller_is_refused_with_one_line():
    with pytest.raises(MspError, match="does not answer MSP_API_VERSION"):
        query_controller(lambda command: None)
