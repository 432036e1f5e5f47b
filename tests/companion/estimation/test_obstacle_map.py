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
    known = ObstacleMap(ObstacleConfig(associate=0.5))
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
    for _ in range(ObstacleConfig().misses_to_forget):
        assert len(fly(known, 1.0, None, visibility=lambda places: places[:, 0] < PLACE[0] - 0.5))
    for _ in range(ObstacleConfig().misses_to_forget):
        left = fly(known, 1.0, None)
    assert not len(left)


def test_a_near_trunk_cut_by_the_edge_of_the_picture_stays_where_it_is():
    """By the part of its width that shows it would stand far off and to the side."""
    known = ObstacleMap(ObstacleConfig(associate=0.5))
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
    for _ in range(40):
        left = fly(known, 1.0, visibility=lambda places: np.full(len(places), 0.05))
    assert len(left)
    for _ in range(60):
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
    for _ in range(5):
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
    before = known._landmarks[0].misses
    known.see_through(eye, FixedPoints.from_rows(np.array(rows)))
    expected = not wrong and abs(aside) < 0.6 and crossing > 0.3
    assert known._landmarks[0].misses - before == float(expected)


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
    config = ObstacleConfig(misses_to_forget=3)
    known, far, near = ObstacleMap(config), np.array([6.0, 0.0]), np.array([3.0, beside])

    def seen(x, axis, radius):
        offset = axis - [x, 0.0]
        direction = np.array([-offset[1], 0.0, offset[0]]) / np.linalg.norm(offset)
        return Trunk(direction, float(np.linalg.norm(offset)), radius, 0.05)

    for x in 0.01 * np.arange(6):
        fly(known, x, seen(x, far, 0.2), seen(x, near, 0.25))
    for x in 0.06 + 0.01 * np.arange(4):
        found = fly(known, x, seen(x, near, 0.25))
    assert len(found) == 2 - misses


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("associate", 0.0),
        ("overlap", -0.1),
        ("hits_to_confirm", 0),
        ("hits_to_keep", 0),
        ("doubtful_unseen", 0.0),
        ("misses_to_forget", 0),
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
        ("associate", 0.5),
        ("overlap", 0.0),
        ("hits_to_confirm", 1),
        ("hits_to_keep", 1),
        ("doubtful_unseen", 0.5),
        ("misses_to_forget", 1),
        ("keep_range", 0.5),
        ("view_range", 0.5),
        ("sigma_floor", 0.01),
    ],
)
def test_small_numbers_of_the_map_are_taken(name, value):
    assert getattr(ObstacleConfig(**{name: value}), name) == value


def trunk(distance, left=0.0, radius=0.5, sigma=0.1, **seen):
    """A trunk `left` [rad] of straight ahead."""
    return Trunk(np.array([-np.sin(left), 0.0, np.cos(left)]), distance, radius, sigma, **seen)


def by_width(half, left=0.0, radius=1.0, sigma=0.4, both=False):
    """A trunk without a foot: its radius is assumed, `half` [rad] of its width shows.

    both: whether both of its edges do.
    """
    shown = {"assumed": True, "half_width": half if both else 0.0}
    return trunk(radius / np.sin(half), left, radius, sigma, **shown)


def see(known, *trunks, at=(0.0, 0.0), time=0.0, yaw=0.0, turns=0.0, half_view=1.4, **seen):
    """Take one look, turning at `turns` [rad/s]; return the trunks, with the σ of their places."""
    q = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    p, omega = np.array([*at, 2.0]), np.array([0.3, -0.4, turns])
    known.update(trunks, VehicleState(time, p, np.zeros(3), q, omega), FORWARD, half_view, **seen)
    return known.doubted_cylinders(p)


def hide(places):
    """Visibility of a picture in which nothing shows."""
    return np.zeros(len(places))


def seen_times(looks, *trunks, **config):
    """Return a map that has seen these trunks so often, in frames of one time and place."""
    known = ObstacleMap(ObstacleConfig(**config))
    for _ in range(looks):
        see(known, *trunks)
    return known


def test_a_trunk_counts_from_its_third_look_on():
    known = ObstacleMap(ObstacleConfig())
    assert [len(see(known, trunk(4.0))) for _ in range(3)] == [0, 0, 1]


def test_an_empty_map_has_rows_of_no_trunk():
    known = ObstacleMap(ObstacleConfig())
    assert known.occluders().shape == known.cylinders(np.zeros(3)).shape == (0, 3)
    assert known.doubted_cylinders(np.zeros(3)).shape == (0, 4)


def test_a_trunk_stands_in_its_level_direction_at_its_level_distance():
    """The camera sees a point 37° below it, ahead of a drone that looks north-west."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    below = Trunk(np.array([0.0, 0.6, 0.8]), 4.0, 0.5, 0.1)
    found = see(known, below, at=(3.0, -1.0), yaw=0.75 * np.pi)
    root = np.sqrt(0.5)
    assert found == pytest.approx(np.array([[3.0 - 4.0 * root, -1.0 + 4.0 * root, 0.5, 0.1]]))


def test_the_trunk_with_the_nearest_surface_comes_first():
    known = seen_times(3, trunk(4.0, 0.0, 0.2), trunk(4.3, 1.0, 1.0))
    assert known.cylinders(np.zeros(3))[:, 2].tolist() == pytest.approx([1.0, 0.2])
    assert known.cylinders(np.array([4.0, -3.0, 2.0]))[:, 2].tolist() == pytest.approx([0.2, 1.0])


@pytest.mark.parametrize(
    ("looks", "later", "left"), [(5, 1.5, 1), (5, 1.51, 0), (6, 1.51, 1), (6, 99.0, 1)]
)
def test_a_trunk_of_few_looks_is_forgotten_soon(looks, later, left):
    known = seen_times(looks, trunk(4.0))
    assert len(see(known, time=later, visibility=hide)) == left


def test_the_time_unseen_counts_from_the_last_look():
    known = seen_times(4, trunk(4.0))
    see(known, trunk(4.0), time=1.0)
    assert len(see(known, time=2.4, visibility=hide)) == 1


def test_four_misses_make_a_trunk_forgotten_and_a_look_makes_good_for_all_of_them():
    known = seen_times(6, trunk(4.0))
    for _ in range(3):
        see(known)
    see(known, trunk(4.0))
    assert [len(see(known)) for _ in range(4)] == [1, 1, 1, 0]


def test_a_new_trunk_has_not_been_missed_yet():
    known = seen_times(1, trunk(4.0), hits_to_confirm=1, hits_to_keep=1)
    assert [len(see(known)) for _ in range(4)] == [1, 1, 1, 0]


@pytest.mark.parametrize(("distance", "left"), [(19.9, 1), (20.1, 0)])
def test_a_trunk_is_kept_up_to_20_m(distance, left):
    known = seen_times(6, trunk(4.0))
    assert len(see(known, at=(4.0 - distance, 0.0), visibility=hide)) == left


@pytest.mark.parametrize(
    ("distance", "left"),
    [(6.1, 1), (5.9, 0), (0.85, 0), (0.75, 1)],  # within 0.3 m of its surface it fills the view
)
def test_a_trunk_must_be_seen_within_6_m_unless_it_is_very_near(distance, left):
    known = seen_times(6, trunk(4.0))
    for _ in range(4):
        found = see(known, at=(4.0 - distance, 0.0))
    assert len(found) == left


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("aside", "left"), [(0.78, 0), (0.82, 1)])
def test_a_trunk_must_be_seen_up_to_02_rad_from_the_edge_of_the_view(side, aside, left):
    known = seen_times(6, trunk(4.0))
    for _ in range(4):
        found = see(known, yaw=side * aside, half_view=1.0)
    assert len(found) == left


def test_the_frame_tells_how_far_it_shows_the_axis_at_the_height_of_the_drone():
    known, asked = seen_times(6, trunk(4.0)), []
    see(known, visibility=lambda places: asked.append(places) or np.zeros(len(places)))
    assert np.concatenate(asked) == pytest.approx(np.array([[4.0, 0.0, 2.0]]))


def test_a_farther_trunk_does_not_cover_a_nearer_one():
    known = seen_times(6, trunk(3.0), trunk(5.0))
    for _ in range(4):
        found = see(known, trunk(5.0))
    assert found[:, 0] == pytest.approx([5.0])


def moved(to, sigma=0.05):
    """Return the trunks that two looks at 4 m and `to` [m], in two frames, are taken for."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    see(known, trunk(4.0, 0.0, 0.1, sigma))
    return see(known, trunk(to, 0.0, 0.1, sigma), visibility=hide)


@pytest.mark.parametrize(
    ("apart", "places"), [(0.66, [4.33]), (0.69, [4.0]), (0.78, [4.0]), (0.81, [4.0, 4.81])]
)
def test_looks_in_two_frames_are_of_one_trunk_as_far_as_their_doubt_explains(apart, places):
    """Up to 0.3 m and four times σ: of 0.05 m along the second look, of 0.02 rad at 4 m before.

    Farther apart the second is at first a trunk of its own, of 0.02 rad at 4.7 m.
    """
    assert 0.66 < 0.3 + 4.0 * np.hypot(0.05, 0.02 * 4.0) < 0.69
    assert 0.78 < 0.3 + 4.0 * np.hypot(0.02 * 4.8, 0.02 * 4.0) < 0.81
    assert moved(4.0 + apart)[:, 0] == pytest.approx(places)


@pytest.mark.parametrize(("apart", "trunks"), [(1.18, 1), (1.22, 2)])
def test_looks_more_than_12_dm_apart_are_of_two_trunks_however_doubtful(apart, trunks):
    assert len(moved(4.0 + apart, sigma=2.0)) == trunks


@pytest.mark.parametrize(("apart", "trunks"), [(0.54, 1), (0.58, 2)])
def test_looks_in_one_frame_are_of_one_trunk_where_they_overlap(apart, trunks):
    """By 0.7 of the sum of their radii, 0.5 and 0.3 m."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    assert len(see(known, trunk(4.0), trunk(4.0 + apart, 0.0, 0.3))) == trunks


def test_a_look_belongs_to_the_nearest_of_two_trunks():
    for order in ((4.0, 5.2), (5.2, 4.0)):
        known = seen_times(3, *(trunk(d, 0.0, 0.1, 0.3) for d in order))
        found = see(known, trunk(4.7, 0.0, 0.1, 0.3), trunk(4.0, 0.0, 0.1, 0.3))
        assert found[:, 0] == pytest.approx([4.0, 5.2 - 0.5 / 4.0])


def test_looks_are_averaged_by_their_doubt():
    """Four looks of 0.1 m: at 4.0, 4.2, 4.4 m, with radii of 0.5, 0.4, 0.6 m."""
    known = ObstacleMap(ObstacleConfig())
    for distance, radius in ((4.0, 0.5), (4.2, 0.4), (4.4, 0.6)):
        found = see(known, trunk(distance, 0.0, radius))
    assert found[0] == pytest.approx([4.2, 0.0, 0.5, 0.1 / np.sqrt(3.0)], abs=1e-9)


def test_a_look_at_a_known_trunk_that_shows_too_slim_counts_less():
    """It shows 0.2 m slimmer than known, so that its middle may lie 0.2 m off on either side."""
    known = seen_times(3, trunk(4.0))
    before, look_variance = 0.01 / 3.0, 0.01 + 0.2**2
    share = before / (before + look_variance)
    found = see(known, trunk(4.3, 0.0, 0.3))
    assert found[0, :3] == pytest.approx([4.0 + share * 0.3, 0.0, 0.5 - share * 0.2])


def test_a_direction_is_as_doubtful_as_the_drone_turns_fast():
    """0.02 rad, and 0.01 s of turning at 5 rad/s: 0.05 rad."""
    for turns in (5.0, -5.0):
        known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
        found = see(known, trunk(4.0), turns=turns)
        assert found[0, 3] == pytest.approx(4.0 * np.hypot(0.02, 0.05))


def test_the_turn_about_the_vertical_counts_whatever_the_attitude():
    """A drone on its side that has turned to the left; its body's y axis points up."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    q, p = np.full(4, 0.5), np.array([0.0, 0.0, 2.0])
    own = VehicleState(0.0, p, np.zeros(3), q, np.array([0.3, 5.0, 0.4]))
    known.update([Trunk(np.array([1.0, 0.0, 0.0]), 4.0, 0.5, 0.1)], own, LEVEL, 1.4)
    assert known.doubted_cylinders(p)[0, 3] == pytest.approx(4.0 * np.hypot(0.02, 0.05))


def test_the_width_of_a_trunk_counts_less_where_the_drone_turns():
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=3))
    see(known, trunk(4.0))
    see(known, trunk(4.0, 0.0, 0.4), turns=5.0)
    before, now = 0.1**2, 0.1**2 + (0.05 * 4.0) ** 2
    assert known.occluders()[0, 2] == pytest.approx(0.5 - 0.1 * before / (before + now))


def test_the_place_of_a_trunk_is_never_surer_than_3_cm():
    known = seen_times(40, trunk(1.0, 0.0, 0.2))
    assert see(known, trunk(1.0, 0.0, 0.2))[0, 3] == pytest.approx(0.03, rel=1e-3)


@pytest.mark.parametrize(
    ("distance", "radius", "both", "across"),
    [
        (1.25, 1.0, False, 0.1 * 4.0 / 3.0),  # half its width: 53°
        (0.9, 1.0, False, 0.1 * np.tan(1.4)),  # as far as a picture tells: 80°
        (1.25, 1.0, True, 0.0),
    ],
)
def test_an_edge_that_is_cut_off_leaves_the_axis_open_across_the_line_of_sight(
    distance, radius, both, across
):
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    shown = {"assumed": True, "half_width": np.arcsin(radius / distance) if both else 0.0}
    found = see(known, trunk(distance, 0.0, radius, 0.1, **shown))
    assert found[0, 3] == pytest.approx(max(np.hypot(0.02 * distance, across), 0.1))


@pytest.mark.parametrize(
    ("radius", "half", "trunks"),
    [
        (0.5, 0.185, 1),  # known to be 0.125 rad: half as much again is 0.188 rad
        (0.5, 0.191, 2),
        (0.1, 0.063, 1),  # known to be 0.025 rad: two columns on either side are 0.04 rad
        (0.1, 0.067, 2),
    ],
)
def test_a_trunk_that_shows_much_wider_than_the_known_one_is_another(radius, half, trunks):
    known = seen_times(3, trunk(4.0, 0.0, radius))
    see(known, by_width(half))
    assert len(known.occluders()) == trunks


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("aside", "both", "trunks"),
    [
        (0.22, False, 1),  # they overlap: 0.125 and 0.1 rad
        (0.23, False, 2),
        (0.12, True, 1),  # the known one covers its middle
        (0.13, True, 2),
    ],
)
def test_a_trunk_without_a_foot_is_the_known_one_in_its_direction(side, aside, both, trunks):
    known = seen_times(3, trunk(4.0))
    see(known, by_width(0.1, side * aside, both=both))
    assert len(known.occluders()) == trunks


def test_a_trunk_without_a_foot_that_covers_a_slimmer_one_is_that_one():
    known = seen_times(3, trunk(4.0, 0.0, 0.4))
    see(known, by_width(0.14, 0.12, both=True))  # known to be 0.1 rad wide on either side
    assert len(known.occluders()) == 1


def test_a_trunk_without_a_foot_is_the_nearest_of_two_in_its_direction():
    """The farther one is thicker, and shows as wide."""
    near, far = trunk(3.0), trunk(5.0, 0.0, 0.8)
    for order in ((near, far), (far, near)):
        known = seen_times(3, *order)
        found = see(known, by_width(np.arcsin(0.5 / 2.9), both=True), drift=Drift(0.1))
        assert found[0, 0] < 2.995
        assert found[1, 0] == pytest.approx(5.0, abs=0.02)


def test_a_trunk_without_a_foot_is_none_that_is_not_confirmed():
    known = seen_times(2, trunk(4.0))
    see(known, by_width(0.1))
    assert len(known.occluders()) == 2


def test_a_trunk_that_shows_without_its_foot_is_seen():
    """So it is neither missed nor forgotten as one of few looks, and counts as looked at."""
    known = seen_times(3, trunk(4.0))
    for n in range(8):
        see(known, by_width(0.12), time=1.0 * n)
    assert [len(see(known, time=99.0)) for _ in range(4)] == [1, 1, 1, 0]


def width_seen(half, aside=0.0, drift=0.2, turns=0.0):
    """Return x, y, σ of a trunk of 0.5 m, known 4 m ahead to 0.1/√3 m, after a look at its width.

    drift: m, 1 σ of the way since the look before.
    """
    known = seen_times(3, trunk(4.0))
    shown = by_width(half, aside, both=True)
    (found,) = see(known, shown, drift=Drift(drift), turns=turns)
    assert found[2] == pytest.approx(0.5)
    return found[[0, 1, 3]]


def test_the_width_of_a_known_trunk_tells_how_far_it_is():
    """Its radius is known to 0.04 m, half its width to 0.015 rad."""
    half = np.arcsin(0.5 / 3.7)
    noise = 3.7 * np.hypot(0.04 / 0.5, 0.015 / np.tan(half))
    before = 0.01 / 3.0 + 0.2**2
    share = before / (before + noise**2)
    x, y, sigma = width_seen(half)
    assert (x, y) == pytest.approx((4.0 - 0.3 * share, 0.0))
    assert sigma == pytest.approx(np.sqrt((1.0 - share) * before))


@pytest.mark.parametrize("turns", [0.0, 5.0])
def test_the_direction_of_a_trunk_without_a_foot_tells_where_it_is_across(turns):
    half = np.arcsin(0.5 / 4.0)
    before = 0.08**2 / 3.0 + 0.2**2
    noise = 4.0 * np.hypot(0.02, 0.01 * turns)
    share = before / (before + noise**2)
    _, y, _ = width_seen(half, aside=0.05, turns=turns)
    assert y == pytest.approx(share * 4.0 * np.sin(0.05), rel=0.02)


@pytest.mark.parametrize(
    ("distance", "drift", "moves"), [(2.75, 0.05, True), (2.7, 0.05, False), (2.7, 0.2, True)]
)
def test_a_width_that_fits_the_known_trunk_no_more_moves_nothing(distance, drift, moves):
    """Four times σ, of the place and 0.3 m of the width, nearer than 4 m."""
    half = np.arcsin(0.5 / distance)
    along = distance * np.hypot(0.04 / 0.5, 0.015 / np.tan(half))
    limit = 4.0 * np.hypot(along, np.sqrt(0.01 / 3.0 + drift**2))
    assert (4.0 - distance < limit) == moves
    assert (width_seen(half, drift=drift)[0] < 3.999) == moves


def test_a_width_of_more_than_80_degrees_counts_as_80():
    """From 0.6 m, where a width of 1.4 rad on either side puts the axis at 0.507 m."""
    known = seen_times(3, trunk(4.0))
    wide = trunk(1.01, 0.0, 1.0, 0.1, assumed=True, half_width=1.5)
    found = see(known, wide, at=(3.4, 0.0), drift=Drift(0.2))
    distance = 0.5 / np.sin(1.4)
    noise = distance * np.hypot(0.04 / 0.5, 0.015 / np.tan(1.4))
    before = 0.01 / 3.0 + 0.2**2
    share = before / (before + noise**2)
    assert found[0, 0] == pytest.approx(4.0 - share * (0.6 - distance))


def test_many_widths_make_a_place_no_surer_than_3_cm():
    known = seen_times(3, trunk(1.0))
    for _ in range(40):
        found = see(known, by_width(np.arcsin(0.5), both=True))
    assert found[0, 3] == pytest.approx(0.03, rel=1e-3)


def test_a_drone_within_a_known_trunk_takes_what_it_sees_for_another():
    known = seen_times(3, trunk(4.0))
    see(known, by_width(0.1), at=(3.7, 0.0))
    assert len(known.occluders()) == 2


@pytest.mark.parametrize("order", [(4.0, 4.75), (4.75, 4.0)])
def test_of_two_landmarks_that_meet_the_surer_one_stays_and_counts_as_seen_twice(order):
    """The nearer one is surer: 0.02 rad are 0.08 m there. In that frame it is not missed."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=2))
    for distance in order:
        found = see(known, trunk(distance, 0.0, 0.1, 0.05))
    assert found[:, 0] == pytest.approx([4.0])
    assert [len(see(known)) for _ in range(4)] == [1, 1, 1, 0]


def test_two_trunks_of_one_frame_that_meet_count_as_one_look_more():
    """They are 0.75 m apart, then by their means 0.62 m: less than 0.7 of both radii."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=4))
    see(known, trunk(4.0), trunk(4.75))
    see(known, trunk(4.1), trunk(4.6))
    assert len(known.occluders()) == 1
    assert not len(known.cylinders(np.zeros(3)))
    assert len(see(known, trunk(4.0))) == 1


@pytest.mark.parametrize(
    ("x", "aside", "left"),
    [(0.0, 0.28, 0), (0.0, 0.32, 1), (3.4, 0.0, 0), (3.6, 0.0, 1)],  # from within none is a look
)
def test_lines_of_sight_count_where_they_pass_the_middle_of_a_trunk_ahead(x, aside, left):
    """It is 0.5 m in radius; its middle is 0.6 of that."""
    known, p = seen_times(6, trunk(4.0)), np.array([x, aside, 2.0])
    places = [[9.0, aside, 2.0, 0.05, n] for n in (0.0, 1.0)]
    for _ in range(4):
        known.see_through(p, FixedPoints.from_rows(np.array(places)))
    assert len(see(known, visibility=hide)) == left


@pytest.mark.parametrize(
    ("assumed", "shift"), [(False, 0.01 * (3.5**2 + 2.0**2) / 2.0), (True, 0.0)]
)
def test_an_unsure_tilt_leaves_open_where_a_foot_is_and_not_a_width(assumed, shift):
    """The foot of the trunk, 0.5 m nearer than its axis, is seen from 2 m up."""
    known = ObstacleMap(ObstacleConfig(hits_to_confirm=1))
    found = see(known, trunk(4.0, assumed=assumed), drift=Drift(tilt=0.01))
    assert found[0, 3] == pytest.approx(np.hypot(0.1, shift))
