"""Numbers that are none, in every float of every message: refused without an error or a warning.

A warning is an error in these tests, and a line in the journal for each message in flight.
"""

import math
import re

import numpy as np
import pytest

from companion.estimation.own_state import OwnState
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect import TO_WIRE
from mavlink_bridge.wire.dialect.pack import packed
from mavlink_bridge.wire.framing import framed
from tests.mavlink_bridge.wire.test_codec import EXAMPLES

BAD = [math.nan, math.inf, -math.inf, 3e38, -3e38, 1e-44]


def spoilt(example):
    """Frames of a message, each with one float that is none, and the name of the field."""
    wire = TO_WIRE[type(example)](example)
    kind = type(wire).layout
    codes = re.findall(r"\d*([a-zA-Z])", kind.form.format)
    for name, code in zip(kind.read._fields, codes, strict=True):
        if code not in "fd":
            continue
        value = getattr(wire, name)
        for i in range(len(value)) if isinstance(value, list | tuple) else [None]:
            for bad in BAD:
                new = bad if i is None else [*value[:i], bad, *value[i + 1 :]]
                payload = packed(wire._replace(**{name: new}))
                yield name, bad, framed(payload, kind.number, 0, m.Source(1, 1), 0)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: type(e).__name__)
def test_the_codec_reads_it_or_counts_it(example):
    for name, bad, frame in spoilt(example):
        codec = Codec(1, 191)
        heard = codec.decode(frame)
        assert len(heard) + codec.statistics.bad_frames == 1, (name, bad)


STATES = [e for e in EXAMPLES if type(e) in (m.Odometry, m.Attitude, m.LocalPosition)]


@pytest.mark.parametrize("example", STATES, ids=lambda e: type(e).__name__)
def test_no_own_state_is_made_of_it(example):
    good = [
        m.Attitude(2.0, np.array([1.0, 0, 0, 0]), np.zeros(3)),
        m.LocalPosition(2.0, np.array([1.0, 2.0, 3.0]), np.zeros(3)),
    ]
    refused = 0
    for name, bad, frame in spoilt(example):
        own = OwnState()
        if not isinstance(example, m.Odometry):
            own.add(good)
        own.add([r.message for r in Codec(1, 191).decode(frame)])
        own.add([m.Odometry(2.01, good[1].p, good[1].v, good[0].q_wb, np.zeros(3))])
        state = own.at(2.0)
        assert all(np.isfinite(x).all() for x in (state.p, state.v, state.q_wb)), (name, bad)
        refused += own.counters.not_finite > 0
    assert refused >= 20


def test_an_odometry_without_a_velocity_is_counted_and_its_attitude_used():
    """Body velocities of an infinite speed had been turned into the world, with a warning."""
    example = next(e for e in EXAMPLES if isinstance(e, m.Odometry))
    for name, bad, frame in spoilt(example):
        if name in ("vx", "vy", "vz") and not math.isfinite(bad):
            message = Codec(1, 191).decode(frame)[0].message
            assert np.isnan(message.v).all()
            own = OwnState()
            own.add([message])
            assert own.counters.not_finite == 1
            assert len(own.new_attitudes) == 1
            assert own.at(2.0) is None  # no position
