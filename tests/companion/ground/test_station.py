"""The ground station on messages alone: what it keeps, asks, and how often it shows it."""

import asyncio
import contextlib
import json
import select
import socket
import tracemalloc

import numpy as np
import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from companion.ground.drone_view import DroneView, metres
from companion.ground.server import BadRequest, GroundServer, understood
from companion.ground.station import COMPONENT, Station, allowed, wanted
from companion.services.services import PHASES, Situation
from companion.supervision.guard import Reason
from companion.types import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import CommandId, MessageId
from mavlink_bridge.wire.link import open_endpoint
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    GlobalPosition,
    Heartbeat,
    HomePosition,
    LocalPosition,
    NamedValue,
    Received,
    Source,
    StatusText,
)
from tests.companion.ground.emulated import Emulated, config

HOLD, OFFBOARD = 0x03040000, 0x00060000  # of PX4


def test_ten_vehicles_are_shown_ten_times_a_second():
    """By the world's time; the whole page's work for a second of it takes far less than that."""
    world = Emulated(10)
    server = GroundServer(world.station)
    shown = []

    class Shown:
        def show(self, state):
            shown.append(json.dumps(state, allow_nan=False))

    server.pages.add(Shown())
    for _ in range(500):
        world.step()
        server.turn(world.now)
    assert len(shown) == pytest.approx(100, abs=2)
    last = json.loads(shown[-1])["drones"]
    assert [d["mode"] for d in last] == ["hold"] * 10
    assert all(d["battery"][1] > 0.9 and d["companion"]["phase"] == "wait" for d in last)
    np.testing.assert_allclose(
        [d["at"] for d in last], [[6.0 * k, 0.0] for k in range(10)], atol=0.3
    )


def test_memory_is_flat_over_an_hour():
    """Ten drones that talk, say new words, and are asked for something, an hour long."""
    station, hour = Station([config(i + 1) for i in range(10)], MemoryEndpoint(), 254), 3600

    def second(t):
        for i in range(1, 11):
            auto, mate = Source(i, 1), Source(i, 191)
            for m in (
                Heartbeat(12, 2, True, OFFBOARD, 4),
                GlobalPosition(t, 47.0 + t * 1e-7, 8.0, 500.0, 2.0, np.zeros(3)),
                LocalPosition(t, np.array([t * 0.01, 0.0, 2.0]), np.zeros(3)),
                StatusText(4, f"something new at {t}"),
            ):
                station.hear(float(t), Received(auto, m))
            for n, text in enumerate(("x" * 50, f"end {t}")):
                station.hear(float(t), Received(mate, StatusText(4, text, t % 65535 + 1, n)))
            phase = NamedValue(t, "phase", PHASES.index(Phase.FLY if t % 2 else Phase.PASSIVE))
            station.hear(float(t), Received(mate, phase))
        station.hear(float(t), Received(Source(100 + t % 100, 1), Heartbeat(12, 2, True, HOLD, 4)))
        if t % 10 == 0:
            station.act("hold", station.names, float(t))
        station.step(float(t))
        station.snapshot(float(t))

    tracemalloc.start()
    try:
        for t in range(1, hour // 4):  # what is bounded has filled
            second(t)
        before = tracemalloc.get_traced_memory()[0]
        for t in range(hour // 4, hour):
            second(t)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 100_000, f"{grown} bytes in 45 minutes"


def test_a_lost_link_and_a_silent_companion_show_at_once():
    view = DroneView(config())
    view.hear(10.0, Received(Source(1, 1), Heartbeat(12, 2, True, HOLD, 4)))
    view.hear(10.0, Received(Source(1, 191), NamedValue(1.0, "phase", PHASES.index(Phase.FLY))))
    assert (view.lost(11.0), view.lost(11.6)) == (False, True)
    assert (view.companion_lost(12.0), view.companion_lost(12.6)) == (False, True)


def test_a_companion_that_turns_passive_is_shown_by_its_next_tick():
    world = Emulated(1)
    for _ in range(100):
        world.step()
    world.situations[0] = Situation(Phase.FLY, Reason.PLAN)
    world.step()
    world.situations[0] = Situation(Phase.PASSIVE)
    world.step()
    view = world.station.drones[1]
    assert view.phase is Phase.PASSIVE
    assert view.words[-1].text == "fly → passive"


def test_long_words_are_put_together_and_named():
    view = DroneView(config())
    words = "hover thrust is known to +-12% only: a vehicle that hovers tells it"
    for n in range(0, len(words), 50):
        chunk = StatusText(4, words[n : n + 50], 3, n // 50)
        view.hear(1.0, Received(Source(1, 191), chunk))
    assert [(w.who, w.text) for w in view.words] == [("companion", words)]


def test_texts_whose_ends_come_lost_are_not_kept_for_ever():
    view = DroneView(config())
    for n in range(1, 1000):
        view.hear(1.0, Received(Source(1, 191), StatusText(4, "x" * 50, n, 0)))
    assert len(view._chunks) < 20


def test_goals_and_vehicles_lie_on_one_map_though_each_frame_is_its_own():
    world = Emulated(2)
    for _ in range(200):
        world.step()
    drones = world.station.snapshot(world.now)["drones"]
    for d, east in zip(drones, (0.0, 6.0), strict=True):
        np.testing.assert_allclose(d["at"], [east, 0.0], atol=0.3)
        np.testing.assert_allclose(d["goals"], [[east + 5.0, 0.0]], atol=0.3)


def test_the_own_frame_follows_from_home():
    view = DroneView(config())
    home = HomePosition(47.0, 8.0, 500.0, np.array([3.0, -4.0, 0.0]))
    view.hear(0.0, Received(Source(1, 1), home))
    assert metres(view.origin, (47.0, 8.0)) == pytest.approx((3.0, -4.0), abs=1e-3)


def test_it_never_sets_the_rate_of_a_message():
    """On a line that a router shares it would be the rate at which the companion hears, too."""
    world, sent = Emulated(2), []
    send = world.station.codec.encode
    world.station.codec.encode = lambda messages: send(sent.extend(messages) or messages)
    for n in range(1500):
        world.step()
        if n == 300:
            world.station.act("arm", world.station.names, world.now)
        if n == 700:
            world.station.act("takeoff", world.station.names, world.now)
    commands = {m.command for m in sent if isinstance(m, Command)}
    assert CommandId.COMPONENT_ARM_DISARM in commands
    assert CommandId.SET_MESSAGE_INTERVAL not in commands
    assert all(view.armed and view.in_air for view in world.station.drones.values())
    assert [r["ok"] for r in world.station.results] == [True] * 4


def test_what_does_not_come_by_itself_is_asked_for_once_at_a_time():
    view = DroneView(config())
    assert wanted(view, 1.0) == []  # nobody is there
    view.hear(1.0, Received(Source(1, 1), Heartbeat(12, 2, False, HOLD, 4)))
    asked = [m.params[0] for m in wanted(view, 1.0)]
    assert MessageId.HOME_POSITION in asked
    view.hear(1.0, Received(Source(1, 1), HomePosition(47.0, 8.0, 500.0)))
    assert MessageId.HOME_POSITION not in [m.params[0] for m in wanted(view, 1.0)]


def answered(station, action, answer, seconds=12.0):
    """Act with drone 1 and answer each command by answer(command) → result; return the result."""
    station.hear(0.0, Received(Source(1, 1), Heartbeat(12, 2, True, HOLD, 4)))
    station.act(action, ["drone1"], 0.0)
    sent = []
    pending = station._actions.get(1)
    for now in np.arange(0.0, seconds, 0.1):
        if pending is None or pending.result is not None:
            break
        station.hear(now, Received(Source(1, 1), Heartbeat(12, 2, True, HOLD, 4)))
        for m in pending.due(now):
            sent.append(m)
            result = answer(m) if isinstance(m, Command) else None
            if result is not None:
                ack = CommandAck(m.command, result, 254, COMPONENT)
                station.hear(now, Received(Source(1, 1), ack))
    return pending.result, pending.ok, sent


def test_a_command_that_nobody_answers_is_repeated_and_then_told():
    result, ok, sent = answered(Station([config()], MemoryEndpoint(), 254), "land", lambda m: None)
    assert (ok, result) == (False, "no answer: armed, mode hold")
    assert [m.confirmation for m in sent] == [1, 2]  # the first went out at once


def test_a_mode_that_is_acknowledged_and_not_entered_is_told():
    result, ok, _ = answered(Station([config()], MemoryEndpoint(), 254), "land", lambda m: 0)
    assert (ok, result) == (False, "accepted, but not landing within 5 s: armed, mode hold")


def test_signed_vehicles_are_heard_and_obey_and_unsigned_ones_are_strangers():
    world = Emulated(2, key=b"k" * 32)
    for n in range(400):
        world.step()
        if n == 200:
            world.station.act("arm", world.station.names, world.now)
    assert [(r["ok"], r["result"]) for r in world.station.results] == [(True, "done")] * 2
    assert all(view.armed for view in world.station.drones.values())
    assert world.station.drones[1].phase is Phase.WAIT  # of its companion, which signs as well

    for listener, speakers in ((b"k" * 32, None), (b"k" * 32, b"x" * 32), (None, b"k" * 32)):
        world = Emulated(1, key=speakers, station_key=listener)
        for _ in range(200):
            world.step()
        world.station.act("arm", ["drone1"], world.now)
        for _ in range(100):
            world.step()
        assert not world.vehicles.units[0].commander.armed  # it obeys nobody else's key
        heard = world.station.drones[1].armed is not None
        assert heard == (listener is None)  # who does not check hears all


def test_a_refusal_is_told_by_its_name():
    result, ok, _ = answered(Station([config()], MemoryEndpoint(), 254), "land", lambda m: 2)
    assert (ok, result) == (False, "refused (denied): armed, mode hold")


def test_hold_does_not_wait_for_what_is_under_way():
    station = Station([config()], MemoryEndpoint(), 254)
    station.hear(0.0, Received(Source(1, 1), Heartbeat(12, 2, True, HOLD, 4)))
    station.act("takeoff", ["drone1"], 0.0)
    station.act("hold", ["drone1"], 0.1)
    assert [r["result"] for r in station.results] == ["replaced by another"]
    assert station._actions[1].name == "hold"


def test_a_betaflight_cannot_be_asked_to_return():
    station = Station([config(autopilot="betaflight")], MemoryEndpoint(), 254)
    station.hear(0.0, Received(Source(1, 1), Heartbeat(0, 2, True, 101, 4)))
    station.act("return", ["drone1"], 0.0)
    assert station.results[0]["result"] == "betaflight has no mode for that"


def test_a_companion_hears_the_station_only_where_its_file_says_so():
    assert not allowed(config(), 254)
    assert allowed(config(allow=[[254, COMPONENT]]), 254)
    assert allowed(config(allow=[[254, 0]]), 254)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ("[", "not understood"),
        ('{"do": "arm", "drones": []}', "arm of no drone"),
        ('{"do": "arm", "drones": ["ghost"]}', "arm of ghost"),
        ('{"do": "explode", "drones": ["drone1"]}', "explode of drone1"),
        ('{"do": "goals", "drones": ["drone1"]}', "three numbers"),
        ('{"do": "goals", "drones": ["drone1"], "goals": [[1, 2]]}', "three numbers"),
    ],
)
def test_what_a_page_asks_is_checked(asked, why):
    with pytest.raises(BadRequest, match=why):
        understood(asked, ["drone1"])


def served(token, *requests):
    """Serve a station and make requests of it, (path, headers) each; return the statuses."""

    async def serve():
        server = GroundServer(Station([config()], MemoryEndpoint(), 254), token)
        port = server.listen("127.0.0.1", 0)
        told = []
        for path, headers in requests:
            request = HTTPRequest(f"http://127.0.0.1:{port}{path}", headers=headers)
            response = await AsyncHTTPClient().fetch(request, raise_error=False)
            told.append((response.code, response.headers.get("Set-Cookie", "")))
        await server.close()
        return told

    return asyncio.run(serve())


def test_this_machine_needs_no_token_and_a_foreign_name_gets_nothing():
    names = ("localhost:1", "127.0.0.1", "[::1]:1", "evil.example")
    told = served("", ("/", {}), *(("/", {"Host": n}) for n in names))
    assert [code for code, _ in told] == [200, 200, 200, 200, 403]


def test_others_need_the_token():
    cookie = {"Cookie": "ground_token=secret"}
    asked = [("/", {}), ("/fleet", {}), ("/debrief", {}), ("/?token=wrong", {})]
    told = served("secret", *asked, ("/?token=secret", {}), ("/app.js", cookie))
    assert [code for code, _ in told] == [401, 401, 401, 401, 200, 200]
    assert "HttpOnly" in told[4][1]
    assert "SameSite=Strict" in told[4][1]


def test_a_page_of_another_site_cannot_speak_to_the_fleet():
    async def connect(origin):
        server = GroundServer(Station([config()], MemoryEndpoint(), 254))
        port = server.listen("127.0.0.1", 0)
        origin = origin.format(port=port)
        request = HTTPRequest(f"ws://127.0.0.1:{port}/fleet", headers={"Origin": origin})
        try:
            (await websocket_connect(request)).close()
        finally:
            await server.close()

    asyncio.run(connect("http://127.0.0.1:{port}"))
    with pytest.raises(Exception, match="403"):
        asyncio.run(connect("http://evil.example"))


def test_a_frame_that_a_line_has_cut_is_heard():
    """A TCP line: each frame comes in two parts, with a look between."""
    listener = socket.create_server(("127.0.0.1", 0))
    line = open_endpoint(f"tcp:127.0.0.1:{listener.getsockname()[1]}")
    with listener, contextlib.closing(line):
        station = Station([config(1)], line, 255)
        station.step(0.0)
        vehicle = listener.accept()[0]
        with vehicle:
            data = Codec(1, 1).encode([Heartbeat(12, 2, True, HOLD, 3)])
            for n, part in enumerate((data[:9], data[9:])):
                vehicle.sendall(part)
                select.select([line.fileno()], [], [], 5.0)
                station.step(0.1 + 0.1 * n)
    assert station.drones[1].armed is True
