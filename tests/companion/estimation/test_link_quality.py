"""Link quality: lost frames by their sequence numbers, from the wire to the share."""

import numpy as np
import pytest

from companion.estimation.link_quality import LinkQuality
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Heartbeat, SystemTime

HEARTBEAT = Heartbeat(12, 2, True, 0, 4)
SECOND = 200  # frames


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
