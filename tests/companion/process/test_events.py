"""Lines of the journal about what the line refuses."""

import pytest

from companion.process import events as module
from companion.process.events import Events
from mavlink_bridge.wire.codec import CodecStatistics


@pytest.fixture
def told(monkeypatch):
    lines = []
    monkeypatch.setattr(module, "event", lambda name, level, **fields: lines.append(fields))
    return lines


def hear(seconds, counts_at, period=1.0):
    events = Events()
    for n in range(round(seconds / period)):
        events.refused(CodecStatistics(**counts_at(n)), 100.0 + n * period)


def test_a_router_that_passes_on_a_neighbours_heartbeat_is_no_noise(told):
    hear(3600.0, lambda n: {"foreign": n + 1})
    assert len(told) == 1 + 5  # at once, then a count every ten minutes
    assert sum(line["frames"] for line in told) == told[-1]["foreign"] == 3001


def test_another_cause_is_told_at_once(told):
    hear(200.0, lambda n: {"foreign": n + 1, "replayed": 3 * (n >= 50), "unsigned": n >= 80})
    assert [(line["frames"], line["replayed"]) for line in told] == [(1, 0), (53, 3), (31, 3)]


def test_a_cause_that_was_silent_is_news_again(told):
    hear(300.0, lambda n: {"unsigned": (1 if n < 150 else 2)})
    assert [line["unsigned"] for line in told] == [1, 2]


def test_without_a_refusal_nothing_is_told(told):
    hear(1200.0, lambda n: {"received": n})
    assert told == []
