"""Link quality: lost frames by their sequence numbers, from the wire to the share."""

import numpy as np
import pytest

from companion.estimation.link_quality import LinkQuality
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Heartbeat, Received, Source, SystemTime

HEARTBEAT = Heartbeat(12, 2, True, 0, 4)
SECOND = 200  # frames
OTHER = SystemTime(0.1, 0.0)


@pytest.fixture
def frames():
    """Two seconds of a vehicle's frames; their sequence numbers wrap."""
    vehicle, messages = Codec(1, 1), (HEARTBEAT, SystemTime(0.1, 0.0))
    return [vehicle.encode([messages[n % 2]]) for n in range(2 * SECOND)]


def lost(packets):
    """Return the share lost after two seconds of ten ticks each."""
    codec, watch = Codec(1, 191), LinkQuality(2.0)
    for k, part in enumerate(np.array_split(np.arange(len(packets)), 20)):
        watch.hear(0.1 * k, [r for n in part for r in codec.decode_datagram(packets[n])])
    return watch.lost


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5])
def test_lost_frames_are_counted(frames, loss):
    rng = np.random.default_rng(0)
    struck = [b"" if n > SECOND and rng.random() < loss else f for n, f in enumerate(frames)]
    assert lost(struck) == pytest.approx(loss, abs=0.06)


def test_frames_that_come_out_of_order_or_twice_are_not_lost(frames):
    assert lost([f for n in range(0, len(frames), 2) for f in (frames[n + 1], frames[n])]) < 0.02
    assert lost([f for f in frames for _ in range(2)]) == 0.0


def test_frames_of_unknown_messages_are_not_lost(frames):
    unknown = [bytes([*f[:7], 0xEE, 0xEE, 0, *f[10:]]) for f in frames]
    pairs = zip(frames, unknown, strict=True)
    assert lost([pair[n % 3 > 0] for n, pair in enumerate(pairs)]) == 0.0


def test_a_link_that_was_lossy_from_the_start_is_not_judged(frames):
    assert lost([f if n % 2 else b"" for n, f in enumerate(frames)]) == 0.0


def came(count, missing=0, unread=0, message=OTHER):
    """`count` frames, of which the last came after `missing` and `unread` ones."""
    frames = [Received(Source(1, 1), message) for _ in range(count - 1)]
    return [*frames, Received(Source(1, 1), message, missing, unread)]


def that_is_trusted():
    """A link of which twenty frames came at 0 s, and none was missing."""
    watch = LinkQuality(2.0)
    watch.hear(0.0, came(20))
    return watch


def test_frames_of_the_last_second_are_counted():
    watch = that_is_trusted()
    watch.hear(0.5, came(20, missing=10))
    assert watch.lost == pytest.approx(10 / 50)
    watch.hear(0.999, [])
    assert watch.lost == pytest.approx(10 / 50)
    watch.hear(1.0, [])
    assert watch.lost == pytest.approx(10 / 30)
    watch.hear(1.5, [])
    assert watch.lost == 0.0


@pytest.mark.parametrize(("frames", "share"), [(9, 0.0), (10, 0.5)])
def test_fewer_than_twenty_frames_that_came_or_should_have_say_nothing(frames, share):
    watch = that_is_trusted()
    watch.hear(1.0, came(frames, missing=frames))
    assert watch.lost == share


@pytest.mark.parametrize(
    ("frames", "missing", "later"), [(19, 0, 0.0), (20, 0, 0.5), (20, 2, 0.0), (96, 5, 0.5)]
)
def test_a_link_is_judged_once_less_than_a_twentieth_of_twenty_frames_was_missing(
    frames, missing, later
):
    watch = LinkQuality(2.0)
    watch.hear(0.0, came(frames, missing))
    watch.hear(1.0, came(20, missing=20))
    assert watch.lost == later


def test_a_twentieth_that_is_missing_is_too_much_to_begin_with():
    watch = LinkQuality(2.0)
    watch.hear(0.0, came(19, missing=1))
    watch.hear(0.1, came(19, missing=1))
    assert watch.lost == 0.0
    watch.hear(0.2, came(2))
    assert watch.lost == pytest.approx(2 / 42)


def test_frames_that_nobody_reads_came():
    watch = that_is_trusted()
    watch.hear(1.0, came(1, missing=10, unread=29))
    assert watch.lost == pytest.approx(10 / 40)


def test_frames_that_came_after_all_are_missing_no_more():
    watch = that_is_trusted()
    watch.hear(0.1, came(20, missing=-3))
    assert watch.lost == 0.0
    watch.hear(0.2, came(20, missing=8))
    assert watch.lost == pytest.approx(5 / 65)


def test_the_mode_is_known_from_a_heartbeat_to_a_silence():
    watch = LinkQuality(2.0)
    watch.hear(0.0, came(1))
    assert not watch.knows_mode
    watch.hear(1.0, came(1, message=HEARTBEAT))
    assert watch.knows_mode
    watch.hear(3.0, [])
    assert watch.knows_mode
    watch.hear(3.1, came(5))
    assert not watch.knows_mode
    watch.hear(3.2, came(5))
    assert not watch.knows_mode
    watch.hear(3.3, came(1, message=HEARTBEAT))
    assert watch.knows_mode


def test_any_frame_ends_a_silence():
    watch = LinkQuality(2.0)
    watch.hear(0.0, came(1, message=HEARTBEAT))
    for time in (1.5, 3.0, 4.5):
        watch.hear(time, came(1))
        assert watch.knows_mode
