"""The certifier: what flies where a command has no way to stop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.prediction import Prediction
from companion.supervision.certificate import Scene
from companion.supervision.certify import CertificateConfig, Certifier, Flown, braking_law
from companion.supervision.evasion import STRAIGHT, simulate
from companion.supervision.guard_config import GuardConfig
from companion.supervision.neighbour_watch import NeighbourWatch
from companion.types import Track
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import RateCommand

HOVER = RateCommand(np.zeros(3), GRAVITY)
KNOWN = Delay(0.05, 0.003)


def certifier():
    return Certifier(CertificateConfig(enforce=True), GuardConfig(), 0.2)


def moving(speed):
    x0 = np.array([0.0, 0.0, 2.0, speed, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    return Prediction(x0, np.array([GRAVITY, 0.0, 0.0, 0.0]), np.zeros(3), 0.0)


def scene(*neighbours, free=5.0):
    rows = np.array([[*p, *v, 1e-4, 0.0, 1e-3, 0.0, 0.0] for p, v in neighbours]).reshape(-1, 11)
    none = np.zeros((0, 3))
    made = Scene(rows, np.zeros((0, 6)), none, np.zeros((0, 4)), np.full(36, free))
    return lambda: made


def test_a_command_with_room_ahead_flies():
    assert certifier().certify(HOVER, moving(1.6), scene(), KNOWN).flown is Flown.COMMAND


def test_without_room_the_way_that_was_accepted_last_is_flown_on():
    c = certifier()
    at = ((1.4, 0.0, 2.0), (0.0, 0.0, 0.0))
    assert c.certify(HOVER, moving(1.2), scene(at), KNOWN).flown is Flown.COMMAND
    pushed = RateCommand(np.array([0.0, 3.0, 0.0]), GRAVITY)
    found = c.certify(pushed, moving(1.45), scene(at), KNOWN)
    assert found.flown is Flown.WAY
    assert found.margin < 0.0
    assert found.cause == "neighbour"
    assert found.instead.omega[1] < -1.0  # it pitches up, to brake
    assert abs(found.instead.omega).max() <= 3.0


def test_where_nothing_holds_the_way_with_most_room_flies():
    between = [((0.9, 0.25, 2.0), (-2.0, 0.0, 0.0))]
    found = certifier().certify(HOVER, moving(1.6), scene(*between), KNOWN)
    assert found.flown is Flown.NONE
    assert found.margin < 0.0
    assert found.instead.omega[1] < 0.0


def test_a_hovering_drone_leaves_the_course_of_a_fast_neighbour_at_the_last_chance():
    c, flown = certifier(), []
    for k in range(16):
        x = 7.5 - 0.5 * k
        found = c.certify(HOVER, moving(0.0), scene(((x, 0.0, 2.0), (-5.0, 0.0, 0.0))), KNOWN)
        flown.append(found.flown)
        if found.flown is not Flown.COMMAND:
            break
    assert flown[0] is Flown.COMMAND  # early there is room for the plan to evade by itself
    assert flown[-1] is not Flown.COMMAND
    assert found.cause == "course"
    assert 2.0 < x < 6.0
    assert np.linalg.norm(found.instead.omega) > 1.0 or found.instead.c != pytest.approx(GRAVITY)


@pytest.mark.parametrize(
    ("near", "v_max", "fastest", "upright"),
    [
        ((0.95, -0.7), math.inf, 1.8, 0.0),
        ((0.95, -0.7), 1.3, 1.2, 0.0),
        ((0.95, -0.7), 0.7, 0.6, 0.0),
        ((2.0, -4.0), 0.7, 1.8, 0.8),  # who is so fast gives no way
    ],
)
def test_only_who_gives_no_way_is_evaded_faster_than_guidance_allows_or_up_and_down(
    near, v_max, fastest, upright
):
    tried = []
    c = certifier()
    c._tried = lambda ways, *a, **k: tried.append(ways) or Certifier._tried(c, ways, *a, **k)
    around = scene(((near[0], 0.0, 2.0), (near[1], 0.0, 0.0)))
    c.certify(HOVER, moving(0.0), around, KNOWN, v_max)
    level = [np.linalg.norm(w.velocity[:, :2], axis=1).max() for w in tried]
    assert max(level) == pytest.approx(fastest)
    assert max(np.abs(w.velocity[:, 2]).max() for w in tried) == upright


@pytest.mark.parametrize(("vy", "fastest"), [(0.0, 1.8), (1.0, 0.6), (2.0, 0.6)])
def test_one_that_comes_no_nearer_presses_nobody(vy, fastest):
    """One that comes at 0.6 m/s, and is too near, is evaded as guidance allows, 0.7 m/s."""
    c, tried = certifier(), []
    c._tried = lambda ways, *a, **k: tried.append(ways) or Certifier._tried(c, ways, *a, **k)
    comes = ((0.85, 0.0, 2.0), (-0.6, 0.0, 0.0))
    other = ((0.0, -2.5, 2.0), (2.0, 1.0 - vy, 0.0))
    c.certify(HOVER, moving(0.0), scene(comes, other), KNOWN, 0.7)
    assert max(np.linalg.norm(w.velocity[:, :2], axis=1).max() for w in tried) == pytest.approx(
        fastest
    )


@pytest.mark.parametrize(
    ("slow", "speed", "fastest"),
    [(0.5, 0.75, 0.6), (0.5, 0.85, 1.8), (1.5, 1.75, 0.6), (1.5, 1.85, 1.8)],
)
def test_who_gives_no_way_follows_from_how_slow_headway_makes_ours(slow, speed, fastest):
    """Only from such a one a way may be faster than guidance allows, 0.7 m/s."""
    c, tried = Certifier(CertificateConfig(), GuardConfig(), 0.2, slow), []
    c._tried = lambda ways, *a, **k: tried.append(ways) or Certifier._tried(c, ways, *a, **k)
    around = scene(((0.95, 0.0, 2.0), (-speed, 0.0, 0.0)))
    c.certify(HOVER, moving(0.0), around, KNOWN, 0.7)
    level = [np.linalg.norm(w.velocity[:, :2], axis=1).max() for w in tried]
    assert max(level) == pytest.approx(fastest)


def test_a_drone_at_rest_leaves_the_course_of_a_slow_neighbour_though_its_plan_is_refused():
    """It could stand with a certificate, and would be run into."""
    c, into = certifier(), RateCommand(np.array([0.0, 3.0, 0.0]), GRAVITY)
    assert c.certify(HOVER, moving(0.0), scene(), KNOWN).flown is Flown.COMMAND
    for x in np.arange(3.0, 0.6, -0.1):
        found = c.certify(into, moving(0.0), scene(((x, 0.0, 2.0), (-1.0, 0.0, 0.0))), KNOWN)
        if found.cause == "course":
            break
    assert found.cause == "course"
    assert x > 0.9
    assert np.linalg.norm(found.instead.omega[:2]) > 0.5


def test_a_way_that_is_held_on_is_compared_by_all_of_the_doubts_as_evasions_are():
    """A neighbour would pass at 0.55 m: room enough by the doubts by which the way still holds."""
    c, into = certifier(), RateCommand(np.array([0.0, 3.0, 0.0]), GRAVITY)
    c.certify(HOVER, moving(0.0), scene(), KNOWN)
    causes = [
        c.certify(into, moving(0.0), scene(((x, 0.55, 2.0), (-1.0, 0.0, 0.0))), KNOWN).cause
        for x in np.arange(3.0, 0.4, -0.1)
    ]
    assert "course" in causes


def test_doubt_of_a_velocity_alone_is_no_reason_to_evade():
    """Among five that stand, each known to 0.15 m and 0.5 m/s, as a network's tracks are."""
    angles = np.pi / 3.0 * np.arange(5)
    ring = [((0.8 * math.cos(a), 0.8 * math.sin(a), 2.0), (0.0, 0.0, 0.0)) for a in angles]
    around = scene(*ring)()
    around.neighbours[:, 6], around.neighbours[:, 8] = 0.15**2, 0.5**2
    found = certifier().certify(HOVER, moving(0.0), lambda: around, KNOWN)
    assert found.flown is Flown.COMMAND


@pytest.mark.parametrize("half", [0.4, 0.6, None])
def test_nobody_is_evaded_through_a_wall(half):
    """From both ends of a tunnel somebody comes: those may give way, its walls will not."""
    along = np.arange(-2.0, 2.01, 0.08)
    walls = []
    if half is not None:
        across = np.arange(-half, half + 0.01, 0.08)
        sides = [(s * half, z) for s in (-1.0, 1.0) for z in across]
        walls = [(x, *yz) for x in along for yz in sides + [(y, z) for z, y in sides]]
    comes = scene(((1.0, 0.0, 2.0), (-1.6, 0.0, 0.0)), ((-1.0, 0.0, 2.0), (1.6, 0.0, 0.0)))()
    around = replace(comes, points=np.array([0.0, 0.0, 2.0]) + np.reshape(walls, (-1, 3)))
    refused, c = RateCommand(np.array([3.0, 0.0, 0.0]), GRAVITY), certifier()
    found = c.certify(refused, moving(0.0), lambda: around, KNOWN)
    assert (found.flown is Flown.WAY) is (half == 0.4)
    turns = np.linalg.norm(found.instead.omega[:2])
    if half == 0.4:
        assert turns == pytest.approx(0.0, abs=1e-9)
        return
    assert turns > 0.5
    if half is not None:  # it makes room, as far as there is any
        law = braking_law(GuardConfig(), KNOWN)
        way = simulate(moving(0.0).x0, c._last, np.zeros(3), law, None)
        assert np.abs(way.p[0] - way.p[0, 0]).max() < half - 0.2


def test_a_drone_that_stands_close_to_a_trunk_does_not_evade_into_it():
    """Doubts take 0.1 m more than there is; two stand beside it, and one comes."""
    beside = [((0.0, y, 2.0), (0.0, 0.0, 0.0)) for y in (-0.5, 0.5)]
    around = scene(*beside, ((-0.7, 0.0, 2.0), (1.0, 0.0, 0.0)))()
    around = replace(around, cylinders=np.array([[0.5, 0.0, 0.2, 0.02, 0.0, 0.0]]))
    c = certifier()
    found = c.certify(
        RateCommand(np.array([0.0, 3.0, 0.0]), GRAVITY), moving(0.0), lambda: around, KNOWN
    )
    law = braking_law(GuardConfig(), KNOWN)
    way = simulate(moving(0.0).x0, c._last, np.zeros(3), law, None)
    assert found.flown is Flown.NONE
    assert np.hypot(way.p[0, :, 0] - 0.5, way.p[0, :, 1]).min() > 0.4


def test_a_drone_that_evades_looks_where_its_plan_looks():
    c = certifier()
    at = ((1.4, 0.0, 2.0), (0.0, 0.0, 0.0))
    c.certify(HOVER, moving(1.2), scene(at), KNOWN)
    pushed = RateCommand(np.array([0.0, 3.0, -0.9]), GRAVITY)
    found = c.certify(pushed, moving(1.45), scene(at), KNOWN)
    assert found.flown is Flown.WAY
    assert found.instead.omega[2] == pytest.approx(-0.9)
    turning = c.certify(
        RateCommand(np.array([0.0, 3.0, 99.0]), GRAVITY), moving(1.45), scene(at), KNOWN
    )
    assert 1.0 < turning.instead.omega[2] <= GuardConfig().omega_max


def test_space_not_looked_at_is_not_flown_into():
    found = certifier().certify(HOVER, moving(1.6), scene(free=0.0), KNOWN)
    assert found.flown is not Flown.COMMAND
    assert found.cause == "unseen"
    assert certifier().certify(HOVER, moving(0.3), scene(free=0.0), KNOWN).flown is Flown.COMMAND


def tracked(t, p, v):
    return Track(3, np.array(p, float), np.array(v, float), np.eye(6) * 1e-4, t, 0.0)


def watched(path, v):
    """What the watch says of a neighbour on a path, of which the tracker tells the velocity v."""
    watch = NeighbourWatch(acceleration=2.0, speed=3.0)
    for t in 0.1 * np.arange(8):
        last = watch.update(t, [tracked(t, path(t), v(t))])
    return last


def test_a_neighbour_within_the_bounds_is_not_reported():
    assert (
        watched(lambda t: (1.5 * t + 0.9 * t * t, 0, 2), lambda t: (1.5 + 1.8 * t, 0, 0)).broken
        == ()
    )


def test_a_neighbour_faster_than_the_bound_is_named_and_its_speed_is_measured():
    found = watched(lambda t: (5.0 * t, 0, 2), lambda t: (3.0, 0, 0))
    assert found.broken == ("neighbour 3: 5.0 m/s, 3 m/s are assumed",)
    assert found.tracks[0].v == pytest.approx([5.0, 0, 0])


def test_a_neighbour_that_swerves_harder_than_the_bound_is_named():
    found = watched(lambda t: (0, 3.0 * t * t, 2), lambda t: (0, 6.0 * t, 0))
    assert len(found.broken) == 1
    assert "m/s² off its course, 2 m/s² are assumed" in found.broken[0]


def test_a_certificate_that_is_not_enforced_is_only_judged():
    watching = Certifier(CertificateConfig(enforce=False), GuardConfig(), 0.2)
    at = ((0.9, 0.25, 2.0), (-2.0, 0.0, 0.0))
    *before, found = [watching.certify(HOVER, moving(1.6), scene(at), KNOWN) for _ in range(5)]
    assert before == [None] * 4  # it costs a tick more than it tells
    assert (found.flown, found.instead) == (Flown.NONE, None)
    assert found.margin < 0.0


def ended(age, after, *others, unseen=0.3):
    """What counts `after` s after a track that flew east at 1 m/s has ended; others: tracks."""
    watch = NeighbourWatch(2.0, 3.0)
    t = Track(3, np.array([4.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0]), np.eye(6), age, unseen)
    watch.update(5.0, [t])
    return watch.update(5.0 + after, list(others)).tracks


def test_a_track_that_ends_counts_until_it_has_not_been_seen_for_a_second():
    (kept,) = ended(2.0, 0.5)
    assert (kept.id, kept.unseen) == (3, pytest.approx(0.8))
    assert kept.p == pytest.approx([4.5, 0.0, 2.0])
    assert len(ended(2.0, 0.65)) == 1
    assert ended(2.0, 0.75) == []


def test_a_memory_that_ends_is_no_neighbour():
    """It was looked for where it was remembered, in vain; it may be anywhere."""
    assert ended(9.0, 0.1, unseen=3.6) == []


def test_the_end_of_a_ghost_or_of_one_that_is_seen_again_is_an_end():
    assert ended(0.3, 0.1) == []
    again = Track(4, np.array([4.4, 0.3, 2.0]), np.zeros(3), np.eye(6), 0.0, 0.0)
    assert ended(2.0, 0.2, again) == [again]
    other = Track(4, np.array([8.0, 0.0, 2.0]), np.zeros(3), np.eye(6), 0.0, 0.0)
    assert [t.id for t in ended(2.0, 0.2, other)] == [4, 3]
    beside = Track(4, np.array([4.4, 0.3, 2.0]), np.zeros(3), np.eye(6), 3.0, 0.0)
    assert [t.id for t in ended(2.0, 0.2, beside)] == [4, 3]  # it was there before


def test_what_was_accepted_is_flown_on_with_half_of_the_doubt():
    def doubtful(x, sigma):
        row = [x, 0.0, 2.0, 0.0, 0.0, 0.0, sigma**2, 0.0, 1e-6, 0.0, 0.0]
        none = np.zeros((0, 3))
        made = Scene(np.array([row]), np.zeros((0, 6)), none, np.zeros((0, 4)), np.full(36, 5.0))
        return lambda: made

    c = certifier()
    before = c.certify(HOVER, moving(1.2), doubtful(3.0, 0.01), KNOWN)
    assert before.flown is Flown.COMMAND
    sure = before.margin + 2.0 * 0.01  # m that are left without any doubt
    found = c.certify(HOVER, moving(1.2), doubtful(3.0, 0.75 * sure), KNOWN)
    assert found.margin < -0.1
    assert found.flown is Flown.WAY


def test_a_climb_comes_to_rest_before_its_way_ends():
    state = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 1.2, 1.0, 0.0, 0.0, 0.0])
    way = simulate(state, STRAIGHT, np.zeros(3), braking_law(GuardConfig(), KNOWN), None)
    still = int(np.argmax(way.v[0, :, 2] == 0.0))
    assert way.v[0, still - 1, 2] < 0.05
    # At 3 m/s² down to 0.67 m/s, from there by the gain of 4.5 1/s: 0.31 m.
    assert way.p[0, -1, 2] - 2.0 == pytest.approx(0.31, abs=0.05)


def test_the_scene_is_that_of_when_the_command_acts():
    """A neighbour that comes at 2 m/s is 0.8 m nearer after 0.4 s; a trunk at 1.5 m/s by 0.6 m."""
    at, none = ((4.0, 0.0, 2.0), (-2.0, 0.0, 0.0)), np.zeros((0, 3))
    trunk = np.array([[3.0, 0.0, 0.3, 0.01, -1.5, 0.0]])
    walks = Scene(np.zeros((0, 11)), trunk, none, np.zeros((0, 4)), np.full(36, 5.0))
    for around, nearer in ((scene(at), 0.8), (lambda: walks, 0.6)):
        now, later = (
            certifier().certify(HOVER, replace(moving(0.5), delay=delay), around, KNOWN).margin
            for delay in (0.0, 0.4)
        )
        assert now - later == pytest.approx(nearer, abs=0.05)
