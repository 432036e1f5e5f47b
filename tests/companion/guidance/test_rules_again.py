"""Threat, speed limits, right of way and fence, against the same rules written a second time."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.guidance.fence import FenceConfig
from companion.guidance.right_of_way import RightOfWayConfig, blocks_way, pass_on_right
from companion.guidance.speed_limits import (
    SpeedLimitConfig,
    headway_speed,
    reaction_speed,
    relative_speed_limit,
    visibility_speed,
)
from companion.guidance.threat import ThreatConfig, rated_neighbours, threat
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

LIMITS = SpeedLimitConfig(
    headway=1.2, clearance=0.9, headway_least=0.25, relative_speed=0.6, reaction_way=0.4,
    full_view=0.5, no_view=1.5, no_view_share=0.15,
)  # fmt: skip
SIDE = RightOfWayConfig(keep_right=1.4, oncoming=5.0, level=1.0)


def drone(rng):
    q = np.array([1.0, 0.0, 0.0, 0.0])
    return VehicleState(0.0, rng.normal(size=3), rng.normal(size=3), q, np.zeros(3))


def neighbours(rng, own, count=3):
    return [
        Track(n, own.p + rng.normal(size=3) * [2.5, 2.5, 0.7], rng.normal(size=3), np.eye(6), 1.0,
              float(rng.choice([0.0, 2.0])))
        for n in range(count)
    ]  # fmt: skip


def level(v):
    return math.hypot(v[0], v[1])


def angle(a, b):
    """From one level direction to another, to the left, -π…π."""
    turn = math.atan2(b[1], b[0]) - math.atan2(a[1], a[0])
    return (turn + math.pi) % (2.0 * math.pi) - math.pi


SEEDS = pytest.mark.parametrize("seed", range(60))


@SEEDS
def test_threat(seed):
    rng = np.random.default_rng(seed)
    own, config = drone(rng), ThreatConfig(closing_floor=0.4, range_max=3.0)
    tracks = neighbours(rng, own, 6)
    values = {}
    for t in tracks:
        away = math.dist(t.p, own.p)
        closing = sum((own.v - t.v) * (t.p - own.p)) / away
        values[t.id] = max(closing, 0.4) * math.exp(1.7) / math.exp(away)
        assert threat(own, t.p, t.v, 1.7, config) == pytest.approx(values[t.id])
    near = [t.id for t in tracks if math.dist(t.p, own.p) <= 3.0]
    found = rated_neighbours(own, tracks, 1.7, config)
    assert [t.id for t, _ in found] == sorted(near, key=lambda n: -values[n])
    assert [value for _, value in found] == pytest.approx([values[t.id] for t, _ in found])


def test_of_two_that_threaten_alike_the_first_number_comes_first():
    own = drone(np.random.default_rng(0))
    one = Track(7, own.p + np.array([2.0, 0.0, 0.0]), own.v, np.eye(6), 1.0, 0.0)
    for tracks in ([one, replace(one, id=4)], [replace(one, id=4), one]):
        assert [t.id for t, _ in rated_neighbours(own, tracks, 2.0, ThreatConfig())] == [4, 7]


@SEEDS
def test_visibility(seed):
    rng = np.random.default_rng(seed)
    yaw, way = rng.uniform(-7.0, 7.0), rng.normal(size=3)
    off = abs(angle([math.cos(yaw), math.sin(yaw)], way))
    share = 1.0 if off < 0.5 else 0.15 if off > 1.35 else 1.5 - off
    assert visibility_speed(LIMITS, yaw, way) == pytest.approx(share, abs=1e-9)


def test_view_ends_behind_where_it_is_full():
    with pytest.raises(ValueError, match=r"no_view, 0.7, must be above full_view, 0.7"):
        SpeedLimitConfig(full_view=0.7, no_view=0.7)


@SEEDS
def test_reaction(seed):
    rng = np.random.default_rng(seed)
    value, sigma = rng.uniform(0.02, 0.5), rng.uniform(0.0, 0.2)
    assert reaction_speed(LIMITS, Delay(value, sigma)) == pytest.approx(0.4 / (value + 2 * sigma))


@SEEDS
def test_headway(seed):
    rng = np.random.default_rng(seed)
    own, way, cruise = drone(rng), rng.normal(size=3), rng.uniform(0.5, 2.0)
    tracks, speed = neighbours(rng, own), cruise
    for t in tracks:
        offset = t.p - own.p
        away = level(offset)
        if math.cos(angle(way, offset)) > 0.3 and abs(offset[2]) < 1.0 and away < 2.5:
            along = (t.v[0] * way[0] + t.v[1] * way[1]) / level(way)
            room = max(away - 0.9, 0.0)
            speed = min(speed, along + room / 1.2)
            # 0.25 s at that speed, and braking by 3 m/s², take the room and the way of its braking.
            way_left = room + max(along, 0.0) ** 2 / 8.0
            speed = min(speed, float(np.roots([1.0 / 6.0, 0.25, -way_left]).max()))
    wanted = max(speed, 0.25 * cruise)
    assert headway_speed(own, tracks, way, cruise, LIMITS, SIDE, 2.5) == pytest.approx(wanted)
    free = LIMITS.model_copy(update={"headway": 0.0})
    assert headway_speed(own, tracks, way, cruise, free, SIDE, 2.5) == cruise
    assert headway_speed(own, tracks, way * [0, 0, 1], cruise, LIMITS, SIDE, 2.5) == cruise


@SEEDS
def test_relative_speed(seed):
    rng = np.random.default_rng(seed)
    own, speed = drone(rng), rng.uniform(0.3, 1.5)
    tracks, bound = neighbours(rng, own), 1.9
    for t in tracks:
        calm = 0.6 + math.dist(t.p, own.p) - 0.9
        bound = min(bound, max(calm, speed) if t.unseen else calm + math.hypot(*t.v))
    found = relative_speed_limit(own, tracks, speed, 1.9, LIMITS)
    assert found == pytest.approx(max(bound, 0.7))
    assert relative_speed_limit(own, tracks, speed, 0.5, LIMITS) == pytest.approx(
        max(min(bound, 0.5), 0.5)
    )


def stands_in_the_way(own, t, goal, near=2.0):
    """Return whether a neighbour blocks the way to a goal."""
    way, offset = (goal - own.p)[:2], (t.p - own.p)[:2]
    if math.cos(angle(way, offset)) <= 0.3 or abs(t.p[2] - own.p[2]) >= 1.0:
        return False
    along = (way @ t.v[:2]) / level(way)
    return bool(along <= 0.3 and level(offset) < min(5.0, max(level(way), near)))


def passage(t, side, trunks):
    """Room on that side, m; none below 1 m."""
    room = 1.4
    for trunk in trunks:
        if (trunk[:2] - t.p[:2]) @ side > 0.0:
            room = min(room, math.dist(trunk[:2], t.p[:2]) - trunk[2] - 0.4)
    return room if room >= 1.0 else None


@pytest.mark.parametrize("seed", range(300))
def test_right_of_way(seed):
    rng = np.random.default_rng(seed)
    own = drone(rng)
    goal = own.p + rng.normal(size=3) * 4.0
    tracks = neighbours(rng, own)
    trunks = np.column_stack([own.p[:2] + rng.normal(size=(2, 2)) * 2.5, rng.uniform(0.1, 0.6, 2)])
    way = (goal - own.p)[:2] / level(goal - own.p)
    right, left = [0.0], [0.0]
    for t in tracks:
        blocks = stands_in_the_way(own, t, goal)
        assert blocks_way(own, t, goal, SIDE) is blocks
        if not blocks:
            continue
        offset = (t.p - own.p)[:2]
        aside, away = way[0] * offset[1] - way[1] * offset[0], level(offset)
        to_right = np.array([way[1], -way[0]])
        if room := passage(t, to_right, trunks):
            if -0.5 * room < aside < room:
                right.append(math.atan2(room - aside, away))
        elif (room := passage(t, -to_right, trunks)) and -0.5 * room < -aside < room:
            left.append(math.atan2(room + aside, away))
    turn = -max(right) if max(right) else max(left)
    turn = min(max(turn, -0.6), 0.6)
    found = pass_on_right(own, tracks, trunks, goal, SIDE)
    assert found[2] == goal[2]
    assert level(found - own.p) == pytest.approx(level(goal - own.p))
    assert angle(way, (found - own.p)[:2]) == pytest.approx(turn, abs=1e-9)


FENCE = FenceConfig(
    east=[-4.0, 6.0], north=[-3.0, 2.0], altitude_min=0.9, ground_min=-2.0, altitude_max=7.0,
    altitude_band=1.5,
)  # fmt: skip


def test_fence_planes():
    assert FENCE.planes().tolist() == [
        [-1, 0, 0, 4.0], [1, 0, 0, 6.0], [0, -1, 0, 3.0], [0, 1, 0, 2.0], [0, 0, 1, 7.0],
    ]  # fmt: skip
    assert FENCE.sides().tolist() == FENCE.planes()[:4].tolist()
    assert FenceConfig(north=[1.0, 2.0]).sides().tolist() == [[0, -1, 0, -1.0], [0, 1, 0, 2.0]]
    assert FENCE.goal_min == pytest.approx(-1.1)


@SEEDS
def test_fence_across_and_near(seed):
    rng = np.random.default_rng(seed)
    p, v = rng.normal(size=3) * 5.0, rng.normal(size=3)
    out = {
        0: (-4.0 - p[0], -v[0]), 1: (p[0] - 6.0, v[0]), 2: (-3.0 - p[1], -v[1]),
        3: (p[1] - 2.0, v[1]), 4: (p[2] - 7.0, v[2]),
    }  # fmt: skip
    assert FENCE.across(p, v) == pytest.approx(max(out.values()))
    wanted = []
    for k, row in enumerate(FENCE.sides()):
        beyond = out[k][0]
        if beyond > -6.0:
            wanted.append([*row[:3], row[3] + (beyond + 0.45 if beyond > 0.0 else 0.0)])
    assert FENCE.near(p, 0.45).ravel() == pytest.approx(np.array(wanted).reshape(-1, 4).ravel())


@pytest.mark.parametrize(
    ("altitude", "floor", "z", "bottom", "top"),
    [(3.0, 0.9, 3.0, 1.5, 4.5), (2.0, 0.9, 2.0, 0.9, 3.5), (6.0, 0.9, 6.0, 4.5, 7.0),
     (6.9, 6.8, 6.9, 6.8, 7.4), (9.0, 0.9, 7.6, 7.1, 8.1), (3.0, 0.9, 1.8, 1.3, 4.5),
     (2.0, 0.9, 1.1, 0.9, 3.5)],
)  # fmt: skip
def test_fence_altitudes(altitude, floor, z, bottom, top):
    planes = FENCE.altitude_planes(altitude, floor, z, 0.5)
    assert planes.ravel() == pytest.approx([0, 0, 1, top, 0, 0, -1, -bottom])
