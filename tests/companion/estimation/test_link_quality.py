"""Lost frames by their numbers, from the wire to the share that is lost."""

import numpy as np
import pytest

from companion.estimation.link_quality import LinkQuality
from companion.supervision.supervision import Supervised
from companion.tick import Tick
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Heartbeat, RateSetpoint, SystemTime

HEARTBEAT = Heartbeat(12, 2, True, 0, 4)
SECOND = 200  # frames


@pytest.fixture
def frames():
    """Two seconds of a vehicle's frames, with numbers that wrap."""
    vehicle = Codec(1, 1)
    return [vehicle.encode([HEARTBEAT, SystemTime(0.1, 0.0)][n % 2 :][:1])
            for n in range(2 * SECOND)]  # fmt: skip


def lost(packets):
    """What is lost in the end, of two seconds at ten ticks each."""
    codec, watch = Codec(1, 191), LinkQuality(2.0)
    for k, part in enumerate(np.array_split(np.arange(len(packets)), 20)):
        watch.hear(0.1 * k, [r for n in part for r in codec.decode_datagram(packets[n])])
    return watch.lost


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5])
def test_what_is_lost_is_counted(frames, loss):
    rng = np.random.default_rng(0)
    struck = [b"" if n > SECOND and rng.random() < loss else f for n, f in enumerate(frames)]
    assert lost(struck) == pytest.approx(loss, abs=0.06)


def test_frames_that_are_overtaken_or_come_twice_are_not_lost(frames):
    assert lost([f for n in range(0, len(frames), 2) for f in (frames[n + 1], frames[n])]) < 0.02
    assert lost([f for f in frames for _ in range(2)]) == 0.0


def test_frames_that_nobody_knows_are_not_lost(frames):
    unknown = [bytes([*f[:7], 0xEE, 0xEE, 0, *f[10:]]) for f in frames]
    assert lost([(f, u)[n % 3 > 0] for n, (f, u) in enumerate(zip(frames, unknown, strict=True))
                 ]) == 0.0  # fmt: skip


def test_a_line_that_was_never_sound_says_nothing(frames):
    assert lost([f if n % 2 else b"" for n, f in enumerate(frames)]) == 0.0


def test_on_a_lossy_line_the_setpoint_goes_out_three_times_and_nothing_else_does():
    setpoint = RateSetpoint(1.0, np.zeros(3), 0.4, 1)
    ticks = [
        Tick(1.0, supervised=Supervised(requests=[HEARTBEAT], repeat=on), setpoint=setpoint)
        for on in (False, True)
    ]
    sound, lossy = ticks
    assert sound.packets == [[HEARTBEAT, setpoint]]
    assert lossy.packets == [[HEARTBEAT, setpoint], [setpoint], [setpoint]]
