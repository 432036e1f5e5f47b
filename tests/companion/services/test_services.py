"""The companion as a component, with pymavlink as the ground station at the other end."""

import math
from importlib.metadata import version

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.guidance.fence import FenceConfig
from companion.perception.config import CameraConfig
from companion.services.services import Services, Situation, Wish
from companion.supervision.guard import Reason
from companion.types import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    ComponentInformation,
    HomePosition,
    Received,
    Source,
)

WAIT, FLY = Situation(Phase.WAIT), Situation(Phase.FLY, Reason.PLAN, 3)
ALL = frozenset({Wish.HOLD, Wish.LAND, Wish.RETURN})
GROUND = (255, 190)


class Ground:
    """A ground station made of pymavlink, on a wire of bytes; the services of drone 7 behind it."""

    def __init__(self, goals=(), wishes=ALL):
        fence = FenceConfig(altitude_max=10.0, east=[-50, 50], north=[-50, 50])
        start = [np.array(g, dtype=float) for g in goals]
        camera = CameraConfig(width=640, height=400)
        self.services = Services(Source(7, 191), camera, fence, start, wishes)
        self.codec = Codec(7, 191)
        self.mine = mavlink.MAVLink(None, *GROUND)
        self.time = 100.0
        self.wish, self.goals = Wish.NONE, None
        self.phase = Phase.WAIT
        self.unasked = self.exchange()

    def exchange(self, *messages, now=WAIT, after=0.1, home=None, settled=True):
        """Send pymavlink's messages, tick once, and return the replies as pymavlink reads them.

        settled: what a new phase makes the companion tell unasked came a tick before.
        """
        if settled and now.phase is not self.phase:
            self.services.update(self.time, [], now)
        self.phase = now.phase
        self.time += after
        received = []
        for m in messages:
            received += self.codec.decode(m.pack(self.mine))
        if home is not None:
            received.insert(0, Received(Source(7, 1), home))
        served = self.services.update(self.time, received, now)
        self.wish = served.wish
        self.goals = self.goals if served.goals is None else served.goals
        parser = mavlink.MAVLink(None)
        return parser.parse_buffer(self.codec.encode(served.messages)) or []

    def upload(self, items, now=WAIT, home=None):
        """Upload items by the protocol; return the MAV_MISSION_RESULT."""
        (reply,) = self.exchange(mavlink.MAVLink_mission_count_message(7, 191, len(items)), now=now)
        while reply.get_type() == "MISSION_REQUEST_INT":
            assert (reply.target_system, reply.target_component) == GROUND
            replies = self.exchange(items[reply.seq], now=now, after=0.01, home=home)
            (reply,) = [m for m in replies if m.get_type().startswith("MISSION")]
        return reply.type


def item(seq, x, y, z, frame=1, command=16):
    """MISSION_ITEM_INT in local NED metres, or in degrees on the Earth."""
    scale = 1e4 if frame in (1, 4) else 1e7
    where = (round(x * scale), round(y * scale), z)
    return mavlink.MAVLink_mission_item_int_message(
        7, 191, seq, frame, command, 0, 1, 0, 0, 0, 0, *where
    )


def command(number, *params):
    return mavlink.MAVLink_command_long_message(
        7, 191, number, 0, *params, *[0.0] * (7 - len(params))
    )


def test_its_heartbeat_says_companion_and_how_it_flies():
    ground = Ground()
    (beat,) = [m for m in ground.unasked if m.get_type() == "HEARTBEAT"]
    assert (beat.type, beat.autopilot, beat.system_status) == (18, 8, 3)  # standby
    later = {"after": 1.0}
    for now, status in ((FLY, 4), (Situation(Phase.FLY, Reason.BRAKE), 5), (WAIT, 3)):
        (beat,) = [m for m in ground.exchange(now=now, **later) if m.get_type() == "HEARTBEAT"]
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (7, 191)
        assert beat.system_status == status


def test_figures_once_a_second():
    ground = Ground()
    for k in range(100):
        ground.services.took(0.05 if k == 7 else 0.004)
    told = [m for _ in range(20) for m in ground.exchange(now=FLY)]
    figures = [m for m in told if m.get_type().startswith("NAMED_VALUE")]
    assert len(figures) == 2 * 9
    values = {m.name: m.value for m in figures}
    assert values["phase"] == 4
    assert values["guard"] == 8  # Reason.PLAN: LATE came before it
    assert values["neighbours"] == 3
    assert values["tick_p99"] == pytest.approx(4.46, abs=0.01)  # ms
    assert all(m.get_type() == "NAMED_VALUE_INT" for m in figures if m.name == "phase")


def test_a_new_phase_is_told_at_once():
    ground = Ground()
    ground.exchange(now=FLY)
    told = ground.exchange(now=Situation(Phase.PASSIVE), after=0.1, settled=False)
    assert [m.system_status for m in told if m.get_type() == "HEARTBEAT"] == [3]
    assert [m.value for m in told if getattr(m, "name", "") == "phase"] == [7]


@pytest.mark.parametrize(("length", "chunks"), [(49, 1), (50, 2), (100, 3), (101, 3)])
def test_the_last_chunk_of_words_is_never_full(length, chunks):
    ground = Ground()
    told = ground.exchange(now=Situation(Phase.WAIT, words="x" * length), after=2.0)
    texts = [m.text for m in told if m.get_type() == "STATUSTEXT"]
    assert (len(texts), "".join(texts)) == (chunks, "x" * length)
    assert len(texts[-1]) < 50


def test_long_words_come_in_chunks_and_again_while_they_hold():
    words = "it flew in offboard before this companion started: a pilot must choose another mode"
    ground = Ground()
    now = Situation(Phase.WAIT, words=words)
    told = [m for _ in range(105) for m in ground.exchange(now=now)]
    texts = [m for m in told if m.get_type() == "STATUSTEXT"]
    assert [(m.id, m.chunk_seq) for m in texts] == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert texts[0].text + texts[1].text == words


def test_uploaded_items_become_goals_in_the_drones_own_frame():
    ground = Ground()
    assert ground.upload([item(0, 3.0, 1.5, -2.0), item(1, 4.0, 2.0, 2.5, frame=4)]) == 0
    np.testing.assert_allclose(ground.goals, [[1.5, 3.0, 2.0], [4.0, 2.0, 2.5]], atol=1e-4)


@pytest.mark.parametrize(("frame", "height"), [(6, 2.0), (5, 490.0), (3, 2.0)])
def test_items_on_the_earth_are_placed_by_the_vehicles_home(frame, height):
    """1e-4 deg are 11.119 m of latitude, and 7.528 m of longitude at 47.4° north."""
    home = HomePosition(47.4, 8.5, 488.0, np.array([1.0, -2.0, 0.5]))
    ground = Ground()
    where = item(0, 47.4001, 8.5001, height, frame=frame)
    assert ground.upload([where], home=home) == 0
    np.testing.assert_allclose(ground.goals, [[1.0 + 7.527, -2.0 + 11.119, 2.5]], atol=0.02)


@pytest.mark.parametrize(
    ("wrong", "result"),
    [
        (item(0, 47.0, 8.0, 2.0, frame=6), 2),  # on the Earth, and home is not known
        (item(0, 1.0, 1.0, -2.0, frame=8), 2),  # the body's frame
        (item(0, 1.0, 1.0, -2.0, command=21), 3),
        (item(0, 60.0, 1.0, -2.0), 5),  # outside the fence
        (item(0, 1.0, 1.0, -20.0), 5),
        (item(0, 1.0, 1.0, math.nan), 5),
    ],
)
def test_an_item_that_is_no_goal_is_refused_and_changes_nothing(wrong, result):
    ground = Ground(goals=[(1, 2, 3)])
    assert ground.upload([wrong]) == result
    assert ground.goals is None
    (count,) = ground.exchange(mavlink.MAVLink_mission_request_list_message(7, 191))
    assert count.count == 1


@pytest.mark.parametrize("phase", [p for p in Phase if p not in (Phase.WAIT, Phase.FLY)])
def test_goals_are_denied_while_they_must_not_change(phase):
    ground = Ground()
    assert ground.upload([item(0, 1, 1, -2)], now=Situation(phase)) == 14
    assert ground.upload([item(0, 1, 1, -2)], now=FLY) == 0


def test_a_lost_item_is_asked_for_again_and_then_the_upload_ends():
    ground = Ground()
    ground.exchange(mavlink.MAVLink_mission_count_message(7, 191, 2))
    told = [m for _ in range(40) for m in ground.exchange()]
    asked = [m for m in told if m.get_type() == "MISSION_REQUEST_INT"]
    ends = [m for m in told if m.get_type() == "MISSION_ACK"]
    assert [m.seq for m in asked] == [0] * 5
    assert [m.type for m in ends] == [15]  # cancelled
    assert ground.goals is None


def test_goals_in_force_can_be_read_back():
    ground = Ground(goals=[(1.5, 3.0, 2.0)])
    (read,) = ground.exchange(mavlink.MAVLink_mission_request_int_message(7, 191, 0))
    assert (read.frame, read.x, read.y, read.z) == (1, 30000, 15000, -2.0)
    (old,) = ground.exchange(mavlink.MAVLink_mission_request_message(7, 191, 0))
    assert (old.get_type(), old.x, old.y) == ("MISSION_ITEM", 3.0, 1.5)
    (beyond,) = ground.exchange(mavlink.MAVLink_mission_request_int_message(7, 191, 1))
    assert beyond.type == 13
    (ack,) = ground.exchange(mavlink.MAVLink_mission_clear_all_message(7, 191))
    assert (ack.type, ground.goals) == (0, [])


@pytest.mark.parametrize(
    ("number", "params", "wish"),
    [(193, (0,), Wish.HOLD), (20, (), Wish.RETURN), (21, (), Wish.LAND)],
)
def test_hold_return_and_land_by_command(number, params, wish):
    ground = Ground()
    (ack,) = ground.exchange(command(number, *params), now=FLY)
    assert (ack.command, ack.result) == (number, 0)
    assert (ack.target_system, ack.target_component) == GROUND
    assert ground.wish is wish
    (ack,) = ground.exchange(command(number, *params), now=WAIT)
    assert ack.result == 1  # it does not fly the vehicle
    assert ground.wish is Wish.NONE


def test_to_go_on_and_what_the_autopilot_cannot_do_are_refused():
    ground = Ground(wishes=frozenset({Wish.HOLD, Wish.LAND}))
    (ack,) = ground.exchange(command(193, 0.5), now=FLY)
    assert ack.result == 2
    (ack,) = ground.exchange(command(193, 1), now=Situation(Phase.LAND))
    assert ack.result == 1
    (ack,) = ground.exchange(command(20), now=FLY)
    assert ack.result == 3
    (ack,) = ground.exchange(command(400, 1), now=FLY)
    assert ack.result == 3
    assert ground.wish is Wish.NONE


@pytest.mark.parametrize("phase", [Phase.PASSIVE, Phase.DONE, Phase.WAIT, Phase.FLY])
def test_resume_is_granted_as_often_as_it_is_asked(phase):
    ground = Ground()
    for _ in range(2):
        (ack,) = ground.exchange(command(193, 1), now=Situation(phase))
        assert (ack.result, ground.wish) == (0, Wish.RESUME)


def test_camera_and_version_on_request():
    ground = Ground()
    ack, camera = ground.exchange(command(512, 259))
    assert ack.result == 0
    assert (camera.resolution_h, camera.resolution_v) == (640, 400)
    assert bytes(camera.model_name).rstrip(b"\0") == b"forward"
    ack, told = ground.exchange(command(512, 148))
    assert (ack.result, told.uid) == (0, 0x53570007)
    (ack,) = ground.exchange(command(512, 30))
    assert ack.result == 2


def test_what_it_is_on_request():
    """pymavlink does not know the message; the product's own codec reads it."""
    services = Ground().services
    ask = Command(512, (396.0, *[0.0] * 6), 7, 191)
    served = services.update(101.0, [Received(Source(255, 190), ask)], WAIT)
    heard = [r.message for r in Codec(255, 190).decode(Codec(7, 191).encode(served.messages))]
    assert [m.result for m in heard if isinstance(m, CommandAck)] == [0]
    (told,) = [m for m in heard if isinstance(m, ComponentInformation)]
    assert (told.vendor, told.model, told.serial) == ("swarm-companion", "companion", "1398210567")
    assert told.software == version("swarm-companion")


def test_messages_to_others_are_left_to_them():
    ground = Ground()
    other = mavlink.MAVLink_command_long_message(7, 1, 21, 0, *[0.0] * 7)
    everyone = mavlink.MAVLink_command_long_message(0, 0, 21, 0, *[0.0] * 7)
    count = mavlink.MAVLink_mission_count_message(7, 1, 2)
    assert ground.exchange(other, everyone, count, now=FLY) == []
    assert ground.wish is Wish.NONE


def test_a_ping_is_answered():
    ground = Ground()
    (pong,) = ground.exchange(mavlink.MAVLink_ping_message(1_250_000, 9, 0, 0))
    assert (pong.time_usec, pong.seq, pong.target_system) == (1_250_000, 9, 255)
    assert ground.exchange(mavlink.MAVLink_ping_message(1_250_000, 9, 7, 191)) == []
