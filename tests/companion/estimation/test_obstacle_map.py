"""The obstacle map: which trunks are one, which are several, and which are forgotten."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.landmark_places import Drift
from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.perception.parallax import FixedPoints
from companion.types import Trunk
from mavlink_bridge.wire.messages import VehicleState

FORWARD = np.array([0.5, -0.5, 0.5, -0.5])  # a camera that looks along the body's x axis
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
THIN, PLACE = 0.24, np.array([4.0, 0.3])


def fly(known, x, *trunks, **visibility):
    """Take one look from (x, 0, 2) m; return the known cylinders."""
    own = VehicleState(x / 1.5, np.array([x, 0, 2.0]), np.array([1.5, 0, 0]), LEVEL, np.zeros(3))
    known.update([t for t in trunks if t], own, FORWARD, np.radians(80.0), **visibility)
    return known.cylinders(own.p)


def look(x, assumed=None):
    """The thin trunk as it is; or of the radius `assumed` [m], and as far off as that makes it."""
    offset = PLACE - [x, 0.0]
    distance = float(np.hypot(*offset))
    direction = np.array([-offset[1], 0.0, offset[0]]) / distance
    if assumed is None:
        return Trunk(direction, distance, THIN, 0.1)
    return Trunk(direction, distance * assumed / THIN, assumed, 0.1 * distance, assumed=True)


def test_a_thin_trunk_whose_foot_left_the_picture_stays_where_it_is():
    known = ObstacleMap(ObstacleConfig())
    for x in np.arange(0.0, 2.4, 0.15):
        fly(known, x, look(x))
    for x in np.arange(2.4, 3.6, 0.05):
        (trunk,) = fly(known, x, look(x, assumed=1.0))
        assert trunk[:2] == pytest.approx(PLACE, abs=0.05)
        assert trunk[2] == pytest.approx(THIN, abs=0.01)


@pytest.mark.parametrize("shows", [True, False])
def test_the_edges_of_a_trunk_without_a_foot_correct_its_place(shows):
    """The way flown since its foot was seen is wrong by 0.15 m, in both directions."""
    known, wrong = ObstacleMap(ObstacleConfig()), np.array([-0.15, 0.15])
    for x in np.arange(0.0, 2.4, 0.15):
        fly(known, x, look(x))
    for x in np.arange(2.4, 3.0, 0.05):
        offset = PLACE + wrong - [x, 0.0]
        distance = float(np.hypot(*offset))
        direction = np.array([-offset[1], 0.0, offset[0]]) / distance
        half = float(np.arcsin(THIN / distance)) if shows else 0.0
        near = Trunk(direction, distance / THIN, 1.0, 0.1 * distance, True, half)
        (trunk,) = fly(known, x, near, drift=Drift(position=0.1))
    assert np.linalg.norm(trunk[:2] - PLACE - wrong) < (0.06 if shows else 0.3)
    assert (np.linalg.norm(trunk[:2] - PLACE) < 0.02) != shows


def test_a_thin_trunk_that_shows_columns_wider_than_known_stays_where_it_is():
    """With its foot in view it was two columns too narrow; without, it is two too wide."""
    known = ObstacleMap(ObstacleConfig())
    for _ in range(6):
        fly(known, 2.0, Trunk(look(2.0).direction, 2.0, 0.075, 0.08))
    for _ in range(6):
        found = fly(known, 2.05, Trunk(look(2.05).direction, 2.26, 0.15, 0.4, assumed=True))
    assert found[:, 2] == pytest.approx([0.075])
    nearer = Trunk(look(2.05).direction, 1.0, 0.15, 0.1, assumed=True)
    for _ in range(3):
        found = fly(known, 2.05, nearer)
    assert found[:, 2] == pytest.approx([0.15, 0.075])


def test_a_distance_by_width_says_nothing_of_the_tilt():
    """A wrong tilt shifts feet, and so what feet tell of other trunks; a width it leaves alone."""
    places = []
    for assumed in (False, True):
        known = ObstacleMap(ObstacleConfig())
        for n in range(8):
            far = Trunk(np.array([0.0, 0.0, 1.0]), 9.0 - 0.2 * n, 0.5, 0.3)
            near = Trunk(np.array([0.6, 0.0, 0.8]), 2.0 + 0.05 * n, 0.5, 0.2, assumed=True)
            fly(known, 0.2 * n, far, near if assumed else None, drift=Drift(tilt=0.02))
        (place,) = [c for c in known.cylinders(np.zeros(3)) if c[0] > 5.0]
        places.append(place)
    np.testing.assert_allclose(places[0], places[1], atol=1e-12)


def test_an_unknown_trunk_has_the_assumed_radius():
    known = ObstacleMap(ObstacleConfig())
    for _ in range(3):
        found = fly(known, 2.4, look(2.4, assumed=0.35))
    assert found[0, 2] == 0.35


def test_a_trunk_beside_a_known_trunk_is_another():
    known = ObstacleMap(ObstacleConfig())
    for _ in range(6):
        fly(known, 2.4, look(2.4))
    aside = Trunk(np.array([0.7, 0.0, 0.7]), 2.0, 1.0, 0.2, assumed=True)
    for _ in range(3):
        found = fly(known, 2.4, aside)
    assert sorted(found[:, 2]) == pytest.approx([THIN, 1.0])


def test_a_trunk_that_should_be_seen_and_is_not_is_forgotten():
    known = ObstacleMap(ObstacleConfig())
    for _ in range(6):
        fly(known, 1.0, look(1.0))
    for _ in range(8):
        assert len(fly(known, 1.0, None, visibility=lambda places: places[:, 0] < PLACE[0] - 0.5))
    for _ in range(8):
        left = fly(known, 1.0, None, depth=True)
    assert not len(left)


def test_a_near_trunk_cut_by_the_edge_of_the_picture_stays_where_it_is():
    """By the part of its width that shows it would stand far off and to the side."""
    known = ObstacleMap(ObstacleConfig())
    for x in np.arange(0.0, 2.4, 0.15):
        fly(known, x, look(x))
    part = Trunk(np.array([-0.24, 0.0, 0.97]), 2.4, 0.15, 0.4, assumed=True)
    for _ in range(6):
        found = fly(known, 3.2, part)
    assert len(found) == 1
    assert found[0, :2] == pytest.approx(PLACE, abs=0.05)


def test_two_landmarks_at_one_place_become_one_at_the_less_uncertain_place():
    """A ghost beside a known trunk would close the way for good: each look keeps it alive."""
    known, ahead = ObstacleMap(ObstacleConfig()), np.array([0.0, 0.0, 1.0])
    for ghost in [5.3] * 3 + [4.7] * 6:
        for distance, sigma in ((4.0, 0.1), (ghost, 0.5)):
            found = fly(known, 0.0, Trunk(ahead, distance, 0.3, sigma))
    assert found == pytest.approx(np.array([[4.0, 0.0, 0.3]]), abs=0.1)


@pytest.mark.parametrize("sigma", [0.05, 0.15])
def test_two_trunks_that_one_frame_shows_stay_two(sigma):
    """A single trunk in their middle would be passed on either side, and a real one flown into."""
    known = ObstacleMap(ObstacleConfig())
    axes = [np.array([5.0, y]) for y in (-0.45, 0.45)]
    rng = np.random.default_rng(0)
    for x in np.arange(0.0, 3.0, 0.1):
        looks = []
        for axis in axes:
            offset = axis - [x, 0.0]
            distance = float(np.hypot(*offset))
            ray = np.array([-offset[1], 0.0, offset[0]]) / distance
            looks.append(Trunk(ray, distance + sigma * rng.normal(), 0.3, sigma))
        seen = looks if round(10 * x) % 3 else looks[:1]  # one of them is missed now and then
        found = fly(known, x, *seen)
    assert found[np.argsort(found[:, 1])][:, :2] == pytest.approx(np.array(axes), abs=0.1)


def test_a_trunk_seen_twice_in_a_frame_is_one():
    """A shadow may part its bark; the two halves would overlap."""
    known = ObstacleMap(ObstacleConfig())
    for _ in range(6):
        rays = [np.array([s, 0.0, 1.0]) / np.hypot(s, 1.0) for s in (-0.05, 0.05)]
        halves = [Trunk(ray, 4.0, 0.4, 0.1) for ray in rays]
        found = fly(known, 0.0, *halves)
    assert len(found) == 1


def test_a_trunk_whose_place_hardly_shows_is_forgotten_late():
    known = ObstacleMap(ObstacleConfig())
    for _ in range(6):
        fly(known, 1.0, look(1.0))
    for _ in range(250):
        left = fly(known, 1.0, visibility=lambda places: np.full(len(places), 0.05))
    assert len(left)
    for _ in range(10):
        left = fly(known, 1.0, visibility=lambda places: np.full(len(places), 0.05))
    assert not len(left)


@pytest.mark.parametrize(("depth", "left"), [(9.0, 0), (4.2, 1), (3.0, 1)])
def test_a_trunk_that_points_are_seen_through_is_forgotten(depth, left):
    """Points behind its place, seen through its middle; points beside or before it say nothing."""
    known, p = ObstacleMap(ObstacleConfig()), np.array([0.0, 0.0, 2.0])
    for _ in range(8):
        fly(known, 0.0, Trunk(np.array([0.0, 0.0, 1.0]), 4.0, 0.4, 0.1))
    places = [[depth, 0.1, 1.9, 0.2, 0.0], [depth, -0.1, 2.2, 0.2, 1.0]]
    behind = FixedPoints.from_rows(np.array(places))
    for _ in range(8):
        known.see_through(p, behind)
    fly(known, -3.0)  # farther than it must be seen from
    assert len(known.cylinders(p)) == left


OUTSIDE = st.one_of(st.floats(-2.5, -0.7), st.floats(0.7, 2.5))


@given(
    course=st.floats(-np.pi, np.pi),
    eye=st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(1.0, 3.0)),
    beyond=st.floats(0.02, 8.0),
    sigma=st.floats(0.0, 0.5),
    aside=st.one_of(st.floats(-0.5, 0.5), OUTSIDE),
    crossing=st.one_of(st.floats(0.4, 3.0), st.floats(-1.0, 0.2)),
    wrong=st.sampled_from(["", "before it", "behind us", "on the far side", "alone"]),
)
def test_a_look_through_a_trunk_is_two_lines_through_its_middle(
    course, eye, beyond, sigma, aside, crossing, wrong
):
    """Lines of sight made from where they cross the trunk, in polar form about the eye."""
    radius, distance = 0.4, 4.0
    known, eye = ObstacleMap(ObstacleConfig()), np.array(eye)
    for _ in range(8):
        fly_at(known, eye[:2] + distance * bearing(course), radius)
    (trunk,) = known.cylinders(eye)
    axis, radius = trunk[:2], trunk[2]
    distance = float(np.hypot(*(axis - eye[:2])))
    course = float(np.arctan2(*(axis - eye[:2])[::-1]))
    angle = course + np.arcsin(np.clip(aside * radius / distance, -1.0, 1.0))
    closest = distance * np.cos(angle - course)  # along the line, where it passes the axis
    # At least this far beyond the trunk, which the doubt of the point allows for.
    far = closest + radius + 0.5 + 4.0 * sigma + beyond
    if wrong == "before it":
        far = max(closest - radius - 0.1, 0.2)
    elif wrong == "behind us":
        angle += np.pi
    elif wrong == "on the far side":
        far = closest + radius + 0.5 + 4.0 * sigma - 0.02
    level = eye[:2] + far * bearing(angle)
    height = eye[2] + (crossing - eye[2]) * far / closest
    rows = [[*level, height, sigma, float(n)] for n in range(1 if wrong == "alone" else 2)]
    before = known._landmarks[0].odds
    known.see_through(eye, FixedPoints.from_rows(np.array(rows)))
    expected = not wrong and abs(aside) < 0.6 and crossing > 0.3
    change = np.log(1.0 - ObstacleConfig().detected) if expected else 0.0
    assert known._landmarks[0].odds - before == pytest.approx(change)


def bearing(angle):
    """Return the level direction (2,) at an angle from east."""
    return np.array([np.cos(angle), np.sin(angle)])


def fly_at(known, axis, radius):
    """Take one look at a trunk from 4 m west of it."""
    p = np.array([axis[0] - 4.0, axis[1], 2.0])
    own = VehicleState(0.0, p, np.zeros(3), LEVEL, np.zeros(3))
    ahead = Trunk(np.array([0.0, 0.0, 1.0]), 4.0, radius, 0.1)
    known.update([ahead], own, FORWARD, np.radians(80.0))


def test_a_trunk_cut_by_the_pictures_edge_moves_nothing():
    """It showed ever slimmer and nearer; all that is known was shifted by 0.4 m within a second."""
    known = ObstacleMap(ObstacleConfig())
    drift = Drift(position=0.02, yaw=0.002)
    near, far = np.array([1.9, 0.0]), np.array([1.5, -5.0])

    def seen(place, radius, cut=0.0):
        """A trunk of which `cut` [m] on its far side is beyond the picture's edge."""
        distance = float(np.hypot(*place))
        shown = place * (1.0 - cut / distance) + cut / distance * np.array([-place[1], place[0]])
        distance = float(np.hypot(*shown))
        direction = np.array([-shown[1], 0.0, shown[0]]) / distance
        return Trunk(direction, distance, radius - cut, 0.1)

    for _ in range(20):
        fly(known, 0.0, seen(near, 1.0), seen(far, 0.9), drift=drift)
    for cut in (0.2, 0.3, 0.4, 0.45, 0.45):
        cut_off = seen(far, 0.9, cut)
        found = fly(known, 0.0, cut_off, drift=drift, visibility=lambda p: np.zeros(len(p)))
    assert found[:, 2] == pytest.approx([1.0, 0.9], abs=0.1)
    assert found[:, :2] == pytest.approx(np.array([near, far]), abs=0.12)


def test_a_near_trunk_whose_edge_is_cut_off_keeps_its_place():
    """Its axis, a guess by its assumed width, lay 0.7 rad beside it: the map moved by 1.1 m."""
    known = ObstacleMap(ObstacleConfig())
    near, far = np.array([0.3, 1.9]), np.array([5.0, -3.0])

    def seen(place):
        distance = float(np.hypot(*place))
        return Trunk(np.array([-place[1], 0.0, place[0]]) / distance, distance, 1.0, 0.1)

    drift = Drift(position=0.02, yaw=0.002)
    for _ in range(12):
        fly(known, 0.0, seen(near), seen(far), drift=drift)
    guess = np.array([-1.4, 1.3])
    distance = float(np.hypot(*guess))
    direction = np.array([-guess[1], 0.0, guess[0]]) / distance
    cut = Trunk(direction, distance, 1.0, 0.49, assumed=True)
    hidden = {"visibility": lambda places: np.zeros(len(places))}
    found = fly(known, 0.0, cut, drift=drift, **hidden)
    assert found[:, :2] == pytest.approx(np.array([near, far]), abs=0.05)


@pytest.mark.parametrize(("beside", "misses"), [(0.0, 0), (0.3, 0), (0.55, 1), (0.9, 1)])
def test_a_trunk_is_not_missed_where_a_nearer_one_covers_part_of_it(beside, misses):
    """It is 6 m off, 0.2 m in radius; one of 0.25 m, 3 m off, covers it up to 0.35 m aside."""
    known, far, near = ObstacleMap(ObstacleConfig()), np.array([6.0, 0.0]), np.array([3.0, beside])

    def seen(x, axis, radius):
        offset = axis - [x, 0.0]
        direction = np.array([-offset[1], 0.0, offset[0]]) / np.linalg.norm(offset)
        return Trunk(direction, float(np.linalg.norm(offset)), radius, 0.05)

    for x in 0.01 * np.arange(6):
        fly(known, x, seen(x, far, 0.2), seen(x, near, 0.25))
    for x in 0.06 + 0.01 * np.arange(9):
        found = fly(known, x, seen(x, near, 0.25))
    assert len(found) == 2 - misses


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("overlap", -0.1),
        ("detected", 0.0),
        ("detected", 1.0),
        ("ghosts", 0.0),
        ("ghosts", 1.0),
        ("doubtful_unseen", 0.0),
        ("keep_range", 0.0),
        ("view_range", 0.0),
        ("sigma_floor", 0.0),
    ],
)
def test_numbers_of_the_map_that_mean_nothing_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        ObstacleConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("overlap", 0.0),
        ("detected", 0.5),
        ("ghosts", 0.01),
        ("doubtful_unseen", 0.5),
        ("keep_range", 0.5),
        ("view_range", 0.5),
        ("sigma_floor", 0.01),
    ],
)
def test_small_numbers_of_the_map_are_taken(name, value):
    assert getattr(ObstacleConfig(**{name: value}), name) == value
