"""TCP and serial lines share a queue and reconnection: here a list is the line."""

import contextlib
import select
from pathlib import Path

import pytest

from mavlink_bridge.wire import bytestream
from mavlink_bridge.wire.bytestream import BAUD_RATES, ByteStream


class Clock:
    """The module's clock."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


class Line(ByteStream):
    """A line that takes `room` bytes. written: what it took. discards: whether it can take back."""

    def __init__(self, discards=False):
        super().__init__("line")
        self.room, self.written, self.arrives = 10**6, b"", []
        self.refuses, self.is_open, self.opened, self.shut = None, False, 0, 0
        self.later, self.discards, self.discarded = False, discards, 0

    @property
    def up(self):
        return self.is_open

    def _open(self):
        self.opened += 1
        if self.refuses is not None:
            raise self.refuses
        self.is_open = not self.later
        return self.is_open

    def _read(self):
        data = self.arrives.pop(0) if self.arrives else b""
        if isinstance(data, Exception):
            raise data
        return data

    def _write(self, data):
        if isinstance(self.room, Exception):
            raise self.room
        taken = data[: self.room]
        self.room -= len(taken)
        self.written += taken
        return len(taken)

    def _take_back(self):
        self.discarded += 1
        return self.discards

    def _shut(self):
        self.is_open, self.shut = False, self.shut + 1

    def _file(self):
        return 77


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(bytestream, "time", clock)
    return clock


@pytest.fixture
def line(clock):
    with contextlib.closing(Line()) as line:
        yield line


def test_whole_messages_go_out_in_order(line):
    assert line.send(b"one")
    assert line.send(b"two")
    assert (line.written, line.opened, line.reconnects) == (b"onetwo", 1, 0)


def test_a_message_that_is_cut_goes_on_where_it_was(line, clock):
    line.room = 2
    assert line.send(b"abcd")
    assert line.send(b"efgh")
    clock.now += 10.0  # the rest of what was begun is never too old
    line.room = 10
    assert line.send(b"ij")
    assert line.written == b"abcdij"


def test_each_part_of_a_message_is_written_once(line):
    line.room = 1
    assert line.send(b"abcdef")
    for n in range(2, 7):
        line.room = 1
        assert list(line.receive()) == []
        assert line.written == b"abcdef"[:n]
    line.room = 9
    assert line.send(b"g")
    assert line.written == b"abcdefg"


@pytest.mark.parametrize(("waited", "sent"), [(0.19, b"oldnew"), (0.21, b"new")])
def test_what_waited_for_more_than_two_ticks_is_dropped(line, clock, waited, sent):
    line.room = 0
    assert line.send(b"old")
    clock.now += waited
    line.room = 100
    assert line.send(b"new")
    assert line.written == sent


def test_what_waits_goes_out_when_the_line_is_read(line, clock):
    line.room = 0
    assert line.send(b"x")
    line.room, clock.now = 10, clock.now + 0.1
    assert list(line.receive()) == []
    assert line.written == b"x"


def test_so_much_waits_for_a_slow_line_and_no_more(line):
    line.room = 0
    assert line.send(bytes(8000))
    assert line.send(bytes(192))
    assert not line.send(b"x")
    line.room = 10**6
    assert list(line.receive()) == []
    assert len(line.written) == 8192
    assert line.send(b"x")


def test_a_message_larger_than_the_queue_is_refused(line):
    assert not line.send(bytes(8193))
    assert line.send(bytes(8192))


def test_a_line_that_takes_nothing_for_two_ticks_refuses(line, clock):
    line.room = 0
    assert line.send(b"a")
    clock.now += 0.15
    assert line.send(b"b")  # it has waited less than it may
    clock.now += 0.1
    assert not line.send(b"c")
    line.room = 100
    assert list(line.receive()) == []
    assert line.written == b"b"  # a is too old, c was refused
    assert line.send(b"d")
    assert line.written == b"bd"


def test_how_long_a_line_is_stuck_counts_from_its_last_byte(line, clock):
    line.room = 0
    assert line.send(b"a")
    clock.now += 0.15
    line.room = 1
    assert list(line.receive()) == []
    assert line.written == b"a"
    assert line.send(b"b")
    clock.now += 0.15
    assert line.send(b"c")
    clock.now += 0.1
    assert not line.send(b"d")


@pytest.mark.parametrize(("discards", "written"), [(True, b"newnew"), (False, b"new")])
def test_a_line_that_was_stuck_discards_what_it_holds_where_it_can(clock, discards, written):
    with contextlib.closing(Line(discards)) as line:
        line.room = 0
        assert line.send(b"old")
        clock.now += 0.3
        assert not line.send(b"gone")
        line.room = 100
        assert line.send(b"new")
        assert line.written == written  # the first one was discarded with what was before it
        assert line.discarded == 1
        assert line.send(b"next")
        assert line.written == written + b"next"
        assert line.discarded == 1


def test_a_message_that_was_cut_is_not_written_anew(clock):
    with contextlib.closing(Line(discards=True)) as line:
        line.room = 1
        assert line.send(b"abc")
        clock.now += 0.3
        assert not line.send(b"gone")
        line.room = 100
        assert list(line.receive()) == []
        assert line.written == b"abc"


def test_chunks_come_until_there_are_none(line):
    line.arrives = [b"ab", b"c"]
    assert list(line.receive()) == [b"ab", b"c"]
    line.arrives = [b"d"]
    assert list(line.receive()) == [b"d"]


def test_a_lost_line_is_named_and_tried_again_every_half_second(line, clock):
    assert line.open()
    line.arrives = [b"a", ConnectionResetError(104, "gone"), b"never"]
    assert list(line.receive()) == [b"a"]
    assert (line.problem, line.up, line.shut) == ("line: gone", False, 1)
    line.refuses = OSError("no text of the system")
    clock.now += 0.49
    assert not line.open()
    assert line.opened == 1
    clock.now += 0.02
    assert not line.open()
    assert (line.opened, line.problem) == (2, "line: no text of the system")
    line.refuses = None
    clock.now += 0.49
    assert list(line.receive()) == []
    assert line.opened == 2
    clock.now += 0.02
    line.arrives = [b"b"]
    assert list(line.receive()) == [b"b"]
    assert (line.problem, line.reconnects, line.opened) == ("", 1, 3)
    line.arrives, clock.now = [ConnectionResetError(104, "gone")], clock.now + 1.0
    assert list(line.receive()) == []
    clock.now += 0.51
    assert line.open()
    assert line.reconnects == 2


def test_a_line_that_opens_by_and_by_is_asked_again_at_once(line):
    line.later = True
    assert not line.open()
    assert not line.send(b"early")
    line.later = False
    assert line.send(b"now")
    assert (line.written, line.opened, line.reconnects) == (b"now", 3, 0)


def test_what_waited_for_a_lost_line_is_not_sent_to_the_next(line, clock):
    line.room = 2
    assert line.send(b"abcd")
    line.room = OSError(5, "pulled")
    assert not line.send(b"ef")
    assert line.problem == "line: pulled"
    assert not line.send(b"while it is down")
    line.room, clock.now = 100, clock.now + 0.6
    assert line.send(b"new")
    assert line.written == b"abnew"
    assert line.reconnects == 1


def test_who_waits_for_a_line_that_is_down_waits_for_its_time(line):
    assert not select.select([line.fileno()], [], [], 0.0)[0]
    assert line.open()
    assert line.fileno() == 77


def descriptors():
    """The process's open files."""
    return len(list(Path("/proc/self/fd").iterdir()))


def test_closing_shuts_the_line_and_leaves_no_descriptor(clock):
    before = descriptors()
    line = Line()
    assert line.open()
    line.close()
    assert (line.up, line.shut) == (False, 1)
    assert descriptors() == before


def test_baud_rates_are_those_of_flight_controllers():
    assert {9600, 57600, 115200, 460800, 500000, 921600, 1500000} <= set(BAUD_RATES)
    assert min(BAUD_RATES) == 9600
