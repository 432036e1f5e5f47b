"""Lost frames by their numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink_bridge.wire.sequence import FrameCount


def counted(*numbers, read=True):
    count = FrameCount()
    for number in numbers:
        count.add(number, read)
    return count.take()


@given(st.integers(0, 255), st.lists(st.booleans(), min_size=1, max_size=600))
def test_what_is_missing_between_the_first_and_the_last_is_counted(first, arrives):
    sent = [(first + n) % 256 for n in range(len(arrives) + 2)]
    arrives = [True, *arrives, True]
    gap = max(map(len, "".join(".x"[a] for a in arrives).split("x")))
    heard = [n for n, a in zip(sent, arrives, strict=True) if a]
    if gap < 127:
        assert counted(*heard) == (arrives.count(False), 0)


@pytest.mark.parametrize(("step", "missing"), [(1, 0), (2, 1), (127, 126), (128, -1), (255, -1)])
@pytest.mark.parametrize("first", [0, 5, 200])
def test_a_step_of_half_the_numbers_is_backwards(first, step, missing):
    assert counted(first, (first + step) % 256) == (missing, 0)


def test_a_frame_that_is_late_was_not_lost():
    count = FrameCount()
    for number in (1, 2, 4):
        count.add(number, read=True)
    assert count.take() == (1, 0)
    count.add(3, read=True)
    assert count.take() == (-1, 0)
    count.add(5, read=True)
    assert count.take() == (0, 0)


def test_a_frame_that_comes_twice_changes_nothing():
    assert counted(7, 7, 7, 8) == (0, 0)


def test_frames_that_are_not_used_are_counted_whether_late_or_not():
    assert counted(1, 3, 2, read=False) == (0, 3)


@pytest.mark.parametrize(
    ("unknown", "missing", "unread"), [(0, 3, 0), (1, 2, 1), (3, 0, 3), (5, 0, 3)]
)
def test_a_frame_that_cannot_be_verified_explains_a_gap(unknown, missing, unread):
    count = FrameCount()
    count.add(10, read=True)
    count.unknown = unknown
    count.add(14, read=True)
    assert (count.unknown, count.take()) == (0, (missing, unread))
    count.add(16, read=True)
    assert count.take() == (1, 0)
