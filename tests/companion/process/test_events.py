"""Lines of the journal about what the line refuses, and where the vehicle's packets come from."""

import logging
import socket
from types import SimpleNamespace

import numpy as np
import pytest

from companion.process import events as module
from companion.process.events import Events
from companion.process.journal import Fields
from companion.tick import Tick, TickInputs
from mavlink_bridge.wire import link as links
from mavlink_bridge.wire.codec import Codec, CodecStatistics
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Attitude, Heartbeat, Source
from mavlink_bridge.wire.udp import UdpEndpoint


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


def test_a_change_of_the_vehicles_address_is_a_warning_that_names_both(monkeypatch, caplog):
    """A router that starts anew: each address once, however many ticks go by."""
    clock = [100.0]
    monkeypatch.setattr(links.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(logging.getLogger("companion"), "propagate", True)
    caplog.set_level(logging.INFO, "companion")
    vehicle, events = Codec(1, 1), Events()
    ours = Link(UdpEndpoint(local=("127.0.0.1", 0)), Codec(1, 191), Source(1, 1))
    routers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    told = [Heartbeat(12, 2, True, 0, 4), Attitude(1.0, np.array([1.0, 0, 0, 0]), np.zeros(3))]
    places = []
    events.address(ours.address)  # not known yet: nothing to tell
    for router in routers:
        clock[0] += 2.0  # the one before is silent
        router.sendto(vehicle.encode(told), ("127.0.0.1", ours.endpoint.port))
        places.append(f"127.0.0.1:{router.getsockname()[1]}")
        for _ in range(3):
            ours.receive()
            events.address(ours.address)
    for end in (ours, *routers):
        end.close()
    lines = [Fields(prefix=True).format(r) for r in caplog.records]
    assert lines == [
        f'<6>vehicle\'s address address={places[0]} before=""',
        f"<4>vehicle's address address={places[1]} before={places[0]}",
    ]


def test_eyes_that_miss_neighbours_are_told_once_a_minute(monkeypatch):
    """Of ten minutes with such eyes; another limit is nothing to tell."""
    told, events = [], Events()
    monkeypatch.setattr(module, "event", lambda name, *_, **fields: told.append({name: fields}))
    for k in range(6000):
        poor = ("surprises", "clear finds")[k % 2]
        limit = poor if 1000 <= k < 3000 and k % 7 else "cruise"
        reference = SimpleNamespace(speed_limit=limit, speed=0.825, strangers=frozenset())
        events.tick(TickInputs(0.1 * k, [], None), Tick(0.1 * k, reference=reference))
    lines = [line["eyes miss neighbours"] for line in told if "eyes miss neighbours" in line]
    assert [line["speed"] for line in lines] == ["0.82"] * 4
    assert [line["time"] for line in lines] == pytest.approx([100.0, 160.1, 220.1, 280.1], abs=0.15)


def test_who_gives_no_way_is_told_once_as_long_as_somebody_does_not(monkeypatch):
    told, events = [], Events()
    monkeypatch.setattr(module, "event", lambda name, *_, **fields: told.append((name, fields)))
    for k, ids in enumerate([(), (7,), (7, 12), (12,), (), (3, 12)]):
        limits = {"speed_limit": "cruise", "speed": 1.0}
        reference = SimpleNamespace(**limits, strangers=frozenset(ids))
        events.tick(TickInputs(float(k), [], None), Tick(float(k), reference=reference))
    lines = [fields for name, fields in told if name == "gives no way"]
    assert lines == [{"neighbours": "7", "time": 1.0}, {"neighbours": "3,12", "time": 5.0}]
