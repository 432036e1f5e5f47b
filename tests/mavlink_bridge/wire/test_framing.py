"""Headers of frames, of bytes laid out as mavlink.io/en/guide/serialization has them."""

import struct

from hypothesis import given
from hypothesis import strategies as st

from mavlink_bridge.wire import framing

BYTE = st.integers(0, 255)


@given(BYTE, BYTE, BYTE, BYTE, st.integers(0, (1 << 24) - 1), st.integers(0, 1), st.integers(0, 9))
def test_a_header_of_the_second_version(size, sequence, system, component, number, flags, at):
    start = struct.pack("<BBBBBBB", 0xFD, size, flags, 0, sequence, system, component)
    data = b"\xaa" * at + start + number.to_bytes(3, "little")
    assert framing.header(data, at) == (sequence, system, component, number)
    assert framing.frame_length(data, at) == 10 + size + 2 + 13 * flags


@given(BYTE, BYTE, BYTE, BYTE, BYTE, st.integers(0, 9))
def test_a_header_of_the_first_version(size, sequence, system, component, number, at):
    data = b"\xaa" * at + struct.pack("<BBBBBB", 0xFE, size, sequence, system, component, number)
    assert framing.header(data, at) == (sequence, system, component, number)
    assert framing.frame_length(data, at) == 6 + size + 2


def test_where_no_system_may_speak_the_first_version_none_of_its_frames_begins():
    first, second = bytes([0xFE, 9, 0, 1, 1, 0]), bytes([0xFD, 9, 0, 0, 0, 1])
    assert framing.start_pattern([]).search(first) is None
    assert framing.start_pattern([]).search(b"\xaa" + second).start() == 1
    assert framing.start_pattern([(1, 0)]).search(b"\xaa" + first).start() == 1
    assert framing.start_pattern([(2, 0)]).search(first) is None
