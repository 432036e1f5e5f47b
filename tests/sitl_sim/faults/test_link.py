"""Faults of the link: packets and telemetry values, by a seed."""

import numpy as np
import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition
from sitl_sim.faults.link import FaultyLine, FaultyTelemetry


@pytest.mark.parametrize(
    ("kind", "amount", "least", "most"),
    [
        ("link_loss", 0.2, 760, 840),
        ("link_duplicate", 0.2, 1160, 1240),
        ("link_reorder", 0.2, 998, 1000),
        ("link_flip", 0.2, 1000, 1000),
    ],
)
def test_the_faults_of_a_line_depend_on_the_seed_alone(schedule, kind, amount, least, most):
    def carried(seed):
        line = FaultyLine(schedule(seed, kind=kind, amount=amount), 0)
        return [p for n in range(1000) for p in line.carry(b"%06d" % n, to_companion=True)]

    assert carried(3) == carried(3) != carried(4)
    assert least <= len(carried(3)) <= most
    assert carried(3) != [b"%06d" % n for n in range(1000)]


def test_garbage_has_its_rate_and_foreign_heartbeats_foreign_ids(schedule):
    line = FaultyLine(schedule(kind="link_garbage", amount=1e6), 0)
    line.carry(Codec(1, 1).encode([Heartbeat(12, 2, True, 0, 4)]), to_companion=True)
    assert sum(len(p) for _ in range(50) for p in line.noise()) == pytest.approx(1e6, rel=0.01)
    line = FaultyLine(schedule(kind="link_foreign", amount=500.0), 0)
    heard = [r for _ in range(50) for p in line.noise() for r in Codec(9, 9).decode_datagram(p)]
    assert 400 < len(heard) < 600
    assert all((r.source.system, r.source.component) != (1, 1) for r in heard)


def altered(schedule, kind, n=50, **more):
    t = FaultyTelemetry(schedule(kind=kind, **more), 0)
    out = []
    for k in range(n):
        out += t.alter(
            0.02 * k,
            [
                Attitude(0.02 * k, np.array([1.0, 0, 0, 0]), np.zeros(3)),
                LocalPosition(0.02 * k, np.zeros(3), np.zeros(3)),
                Heartbeat(12, 2, True, 0, 4),
            ],
        )
    return out


def test_telemetry_faults(schedule):
    kinds = [type(m) for m in altered(schedule, "telemetry_stale")]
    assert set(kinds) == {Heartbeat}
    assert {type(m) for m in altered(schedule, "position_lost")} == {Heartbeat, Attitude}
    for m in altered(schedule, "telemetry_nan"):
        if isinstance(m, Attitude):
            values = np.concatenate([m.q_wb, m.omega])
            assert not np.isfinite(values).all() or (np.abs(values[values != 0]) < 1e-40).any()
    late = [m for m in altered(schedule, "telemetry_late", amount=0.1) if isinstance(m, Attitude)]
    assert len(late) == 45
    assert {
        round(np.linalg.norm(m.q_wb), 3)
        for m in altered(schedule, "quaternion", amount=0.5)
        if isinstance(m, Attitude)
    } == {0.5}


def test_values_that_are_no_numbers_cross_the_wire_as_such(schedule):
    for m in altered(schedule, "telemetry_nan", n=200):
        if isinstance(m, LocalPosition):
            (heard,) = Codec(1, 1).decode(Codec(1, 1).encode([m]))
            values = np.concatenate([heard.message.p, heard.message.v])
            assert (~np.isfinite(values) | ((values != 0) & (np.abs(values) < 1e-38))).any()
