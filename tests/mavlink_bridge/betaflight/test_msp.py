"""MSP frames, their contents, and the rate profile with its inverse."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.msp import Msp, MspDecoder, MspError, Reply
from mavlink_bridge.betaflight.rate_profile import AxisRates, rate_profile
from tests.mavlink_bridge.betaflight.fake_controller import FakeController


def answer_frame(command, payload):
    return b"$M>" + msp.encode(command, payload)[3:]


REPLIES = [Reply(Msp.API_VERSION, b"\0\1\x2f"), Reply(Msp.ATTITUDE, bytes(6)), Reply(3, b"$M>$M")]


@given(st.lists(st.integers(1, 9), max_size=30))
def test_any_chunking_gives_the_same_answers(cuts):
    stream = b"".join(answer_frame(r.command, r.payload) for r in REPLIES)
    decoder, got, at = MspDecoder(), [], 0
    for cut in cuts:
        got += decoder.decode(stream[at : at + cut])
        at += cut
    assert got + decoder.decode(stream[at:]) == REPLIES
    assert decoder.bad_bytes == 0


@given(st.binary(max_size=100))
def test_garbage_never_raises_and_a_later_answer_comes_through(garbage):
    decoder = MspDecoder()
    decoder.decode(garbage)
    stream = answer_frame(1, b"\0\1\x2f") * 100  # more than any false frame can swallow
    assert Reply(1, b"\0\1\x2f") in decoder.decode(stream)


def test_a_flipped_bit_is_refused():
    frame = bytearray(answer_frame(108, bytes(6)))
    frame[7] ^= 4
    assert MspDecoder().decode(bytes(frame)) == []


def test_a_refused_request_is_marked():
    frame = b"$M!" + msp.encode(201)[3:]
    assert MspDecoder().decode(frame) == [Reply(201, b"", refused=True)]


def test_several_answers_in_one_frame():
    fake = FakeController()
    fake.attitude, fake.reasons = (100, -50, 270), 1 << 7 | 1 << 28
    commands = [Msp.ATTITUDE, Msp.STATUS_EX, Msp.ANALOG]
    parts = msp.split(commands, fake.several(commands).payload)
    roll, pitch, heading = msp.attitude(parts[Msp.ATTITUDE])
    assert [math.degrees(a) for a in (roll, pitch, heading)] == pytest.approx([10, -5, 270])
    flags = msp.status(parts[Msp.STATUS_EX]).arming_disabled
    assert msp.arming_reasons(flags) == ["THROTTLE", "ARM_SWITCH"]
    assert msp.battery(parts[Msp.ANALOG]) == (16.8, 1.5)


def test_modes_beyond_the_first_32_are_read():
    head, flags = struct.pack("<3HIBHBB", 125, 0, 0, 1, 0, 10, 4, 0), struct.pack("<BI", 29, 4)
    status = msp.status(head + b"\2\0\1" + flags)
    assert status == msp.Status(1 | 1 << 40, 4)


def test_linear_actual_rates_are_exact():
    profile = rate_profile(FakeController().answer(Msp.RC_TUNING))
    assert profile.roll.stick_for(math.radians(80)) == pytest.approx(0.2, abs=1e-5)
    assert profile.yaw.stick_for(math.radians(-400)) == -1.0
    assert profile.pitch.stick_for(math.radians(900)) == 1.0


@given(
    st.sampled_from([0, 3]),
    st.integers(5, 200),
    st.integers(0, 90),
    st.integers(0, 100),
    st.floats(-1.0, 1.0),
)
def test_the_stick_for_a_rate_gives_that_rate(kind, rc_rate, rate, expo, stick):
    axis = AxisRates(kind, rc_rate, rate, expo, 1998.0)
    wanted = axis.rate_of(stick)
    assert axis.rate_of(axis.stick_for(wanted)) == pytest.approx(wanted, abs=2e-4, rel=1e-4)


def test_unknown_rates_are_refused_with_the_valid_choices():
    fake = FakeController()
    fake.rates = (40, 0, 40, 40, 40, 2)
    with pytest.raises(MspError, match=r"rates_type KISS .* ACTUAL or BETAFLIGHT"):
        rate_profile(fake.answer(Msp.RC_TUNING))
