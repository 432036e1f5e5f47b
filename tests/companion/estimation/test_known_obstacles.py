"""Known obstacles: trunks, surfaces and points of the frames, and how sure their places are."""

import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles, ObstacleEstimator
from companion.estimation.obstacle_map import ObstacleConfig
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.surface_map import SurfaceConfig
from companion.perception.config import CameraConfig
from companion.perception.frontend import Detections
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.parallax import FixedPoints
from companion.perception.view import View, load_camera
from companion.types import Trunk
from mavlink_bridge.wire.messages import VehicleState

SURE = OwnDoubt(0.0, 0.0, 0.0, 0.0, 0.0)
WANDERS = OwnDoubt(0.0, 0.0, 0.1, 0.0, 0.0)  # its velocity is known to 0.1 m/s
SPREAD = 0.1**2 * 2.0 * 0.7  # m²/s: how fast a place grows doubtful by that
AHEAD = Trunk(np.array([0.0, 0.0, 1.0]), 4.0, 0.5, 0.1)
LEFT = Trunk(np.array([-0.6, 0.0, 0.8]), 5.0, 0.5, 0.1)  # at 4 m east, 3 m north


@pytest.fixture(scope="module")
def view():
    return View(load_camera(CameraConfig()), needs_foot=False)


@pytest.fixture
def known(view):
    """One look is enough for a trunk, which is then kept until it is missed four times."""
    trunks = ObstacleConfig(ghosts=1e-4)
    return ObstacleEstimator(view, trunks, SurfaceConfig())


def at(x=0.0, y=0.0, time=0.0, yaw=0.0):
    """A state 2 m up."""
    q = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return VehicleState(time, np.array([x, y, 2.0]), np.zeros(3), q, np.zeros(3))


def look(known, own, *trunks, doubt=SURE, ground=LEVEL, now=None, searched=True, **seen):
    """Take in one frame that `own` took; return what is known around `now`."""
    frame = Detections(own.time, own, trunks=list(trunks), searched=searched, **seen)
    return known.update(frame, now or own, doubt, ground)


def points(*places, sigma=0.05, base=1.0, since=0.0):
    return FixedPoints.from_rows(
        np.array([[*place, sigma, n, base, since] for n, place in enumerate(places)])
    )


# Two corners of one thing, 0.2 m apart, 2 m up at the drone's left.
THING = (0.0, 3.0, 2.0), (0.2, 3.0, 2.0)


def test_at_first_nothing_is_known():
    nothing = KnownObstacles()
    assert nothing.cylinders.shape == nothing.points.shape == nothing.occluders.shape == (0, 3)
    assert nothing.sigmas.shape == (0,)
    assert nothing.widest.shape == (0, 3)


def test_the_widest_trunks_are_two_standard_deviations_wider():
    known = KnownObstacles(
        np.array([[1.0, 2.0, 0.3], [4.0, 5.0, 0.6]]), sigmas=np.array([0.1, 0.2])
    )
    assert known.widest == pytest.approx(np.array([[1.0, 2.0, 0.5], [4.0, 5.0, 1.0]]))
    assert known.cylinders[:, 2].tolist() == [0.3, 0.6]


@pytest.mark.parametrize(
    ("place", "hidden"),
    [
        ((4.0, 0.0), True),
        ((4.0, 1.9), True),  # its line of sight passes the axis at 0.86 m
        ((4.0, 3.0), False),
        ((1.5, 0.0), True),  # within the trunk
        ((0.9, 0.0), False),  # before it
        ((-4.0, 0.0), False),  # the trunk is behind the drone
    ],
)
def test_a_trunk_hides_what_stands_behind_it(place, hidden):
    known = KnownObstacles(occluders=np.array([[2.0, 0.0, 1.0]]))
    assert known.hidden(np.array([0.0, 0.0, 9.0]), np.array([[*place, -9.0]])) == [hidden]


def test_a_line_of_sight_that_touches_a_trunk_is_free():
    known = KnownObstacles(occluders=np.array([[2.0, 0.5, 0.5]]))
    assert known.hidden(np.zeros(3), np.array([[4.0, 0.0, 0.0]])) == [False]


def test_any_of_several_trunks_hides_a_place_and_each_place_counts_for_itself():
    known = KnownObstacles(occluders=np.array([[2.0, 0.0, 0.3], [0.0, 2.0, 0.3]]))
    places = np.array([[4.0, 0.0, 2.0], [4.0, 4.0, 2.0], [0.0, 4.0, 2.0]])
    assert known.hidden(np.zeros(3), places) == [True, False, True]


def test_without_trunks_nothing_is_hidden_and_without_places_there_is_nothing_to_tell():
    assert KnownObstacles().hidden(np.zeros(3), np.ones((2, 3))) == [False, False]
    trunk = KnownObstacles(occluders=np.array([[2.0, 0.0, 1.0]]))
    assert trunk.hidden(np.zeros(3), np.zeros((0, 3))) == []


def test_a_trunk_stands_where_the_frame_showed_it(known):
    """The frame was taken 1 m farther west, and by a drone that looked north."""
    own = at(x=-1.0, yaw=np.pi / 2)
    found = look(known, own, AHEAD, now=at())
    assert found.cylinders == pytest.approx(np.array([[-1.0, 4.0, 0.5]]))
    assert found.occluders == pytest.approx(found.cylinders)
    assert found.sigmas == pytest.approx([0.1])


def test_trunks_are_sorted_by_their_distance_from_where_the_drone_is_now(known):
    near_ahead = look(known, at(), AHEAD, LEFT).cylinders
    assert near_ahead[:, 1] == pytest.approx([0.0, 3.0])
    frame = Detections()
    near_left = known.update(frame, at(x=4.0, y=2.0), SURE).cylinders
    assert near_left[:, 1] == pytest.approx([3.0, 0.0])


def test_trunks_of_a_frame_in_which_none_were_looked_for_do_not_count(known):
    assert not len(look(known, at(), AHEAD, searched=False).cylinders)


def test_without_a_state_only_what_hides_others_is_known(known):
    look(known, at(), AHEAD, fixed=points(*THING))
    found = known.update(Detections(), None, SURE)
    assert found.occluders == pytest.approx(np.array([[4.0, 0.0, 0.5]]))
    assert not len(found.cylinders)
    assert not len(found.sigmas)
    assert not len(found.points)


def test_unconfirmed_trunks_hide_others_and_are_no_obstacles(view):
    known = ObstacleEstimator(view, ObstacleConfig(ghosts=0.1), SurfaceConfig())
    found = look(known, at(), AHEAD)
    assert (len(found.occluders), len(found.cylinders)) == (1, 0)


def test_a_trunk_out_of_view_grows_doubtful_as_the_way_flown_does(known):
    look(known, at(), AHEAD, doubt=WANDERS)
    behind = look(known, at(time=2.0, yaw=np.pi), doubt=WANDERS)
    assert behind.sigmas == pytest.approx([np.sqrt(0.1**2 + SPREAD * 2.0)])
    look(known, at(time=3.0, yaw=np.pi), doubt=WANDERS, searched=False)  # counts later
    behind = look(known, at(time=5.0, yaw=np.pi), doubt=WANDERS)
    assert behind.sigmas == pytest.approx([np.sqrt(0.1**2 + SPREAD * 5.0)])


@pytest.mark.parametrize(("level", "height"), [(0.0, 2.0), (1.0, 1.0)])
def test_an_unsure_tilt_moves_a_foot_by_the_height_over_the_ground_below(known, level, height):
    """Its foot is 3.5 m off: an error of 0.01 rad shifts it by 0.01 (3.5² + h²) / h."""
    tilted = OwnDoubt(0.0, 0.0, 0.0, 0.01, 0.0)
    found = look(known, at(), AHEAD, doubt=tilted, ground=GroundPlane(level))
    shift = 0.01 * (3.5**2 + height**2) / height
    assert found.sigmas == pytest.approx([np.hypot(0.1, shift)])


@pytest.mark.parametrize(("beyond", "left"), [(np.inf, 0), (np.nan, 1)])
def test_a_trunk_is_missed_only_where_the_depth_image_shows_its_place(known, beyond, left):
    look(known, at(), AHEAD)
    for n in range(8):
        found = look(known, at(time=0.1 * n), ranges=np.full((40, 64), beyond, np.float16))
    assert len(found.cylinders) == left


def wall(ranges=3.0):
    """A depth image in which all directions end equally far off [m]."""
    return np.full((40, 64), ranges, np.float16)


def test_surfaces_of_a_depth_image_are_points_unless_a_known_trunk_explains_them(known):
    for n in range(2):
        free = look(known, at(time=0.1 * n), searched=False, ranges=wall())
    lengths = np.linalg.norm(free.points - at().p, axis=1)
    assert lengths == pytest.approx(np.full(len(lengths), 3.0), abs=0.05)
    trunk = Trunk(AHEAD.direction, 3.5, 0.5, 0.1)
    found = look(known, at(time=0.2), trunk)
    gaps = np.linalg.norm(found.points[:, :2] - np.array([3.5, 0.0]), axis=1)
    assert 0 < len(found.points) < len(free.points)
    assert gaps.min() > 0.5 + SurfaceConfig().trunk_margin


def test_points_that_stand_together_are_a_cylinder_round_them(known):
    for n in range(3):
        found = look(known, at(time=0.1 * n), AHEAD, fixed=points(*THING))
    assert found.cylinders == pytest.approx(np.array([[0.1, 3.0, 0.12], [4.0, 0.0, 0.5]]))
    assert found.sigmas[0] == pytest.approx(0.1)
    assert len(found.occluders) == 1
    beyond = known.update(Detections(), at(x=9.0), SURE)
    assert beyond.cylinders[:, 1] == pytest.approx([0.0, 3.0])  # the trunk is the nearer one


def test_points_of_a_wide_shape_stay_points(known):
    hedge = [(x, 3.0, 2.0) for x in np.arange(-2.0, 2.1, 0.25)]
    for n in range(3):
        found = look(known, at(time=0.1 * n), fixed=points(*hedge))
    assert not len(found.cylinders)
    assert found.points == pytest.approx(np.array(hedge))


def test_the_doubt_of_the_own_way_widens_that_of_points(known):
    """They were followed for 0.5 s, over a base of 1.5 m that lies 3 m off."""
    seen = points(*THING, sigma=0.15, base=1.5, since=0.5)
    for n in range(3):
        found = look(known, at(time=0.1 * n), doubt=WANDERS, fixed=seen)
    lengths = np.array([3.0, np.hypot(0.2, 3.0)])
    expected = np.sqrt(0.15**2 + SPREAD * 0.5 * (lengths / 1.5) ** 2).mean()
    assert found.sigmas == pytest.approx([expected])


def test_points_that_are_followed_no_more_grow_doubtful_from_picture_to_picture(known):
    look(known, at(time=5.0), fixed=points(*THING, sigma=0.2))
    look(known, at(time=5.5), doubt=WANDERS)
    found = look(known, at(time=7.0), doubt=WANDERS)
    assert found.sigmas == pytest.approx([np.sqrt(0.2**2 + SPREAD * 2.0)])


@pytest.mark.parametrize(("level", "stands"), [(0.0, 1), (1.7, 0)])
def test_points_on_the_ground_are_no_obstacle(known, level, stands):
    for n in range(3):
        found = look(known, at(time=0.1 * n), fixed=points(*THING), ground=GroundPlane(level))
    assert len(found.cylinders) == stands


@pytest.mark.parametrize(("level", "left"), [(0.0, 0), (1.8, 1)])
def test_a_trunk_that_points_are_seen_through_over_the_ground_is_forgotten(known, level, left):
    ground, through = GroundPlane(level), points((7.0, 0.1, 2.0), (7.0, -0.1, 2.0))
    look(known, at(), AHEAD, ground=ground)
    for n in range(8):
        look(known, at(time=0.1 * n), searched=False, fixed=through, ground=ground)
    hidden = wall(np.nan)
    assert len(look(known, at(time=0.9), ranges=hidden, ground=ground).occluders) == left


def test_points_too_doubtful_to_count_are_not_seen_through_a_trunk(known):
    look(known, at(), AHEAD)
    unsure = points((7.0, 0.1, 2.0), (7.0, -0.1, 2.0), base=0.1, since=9.0)
    for n in range(8):
        look(known, at(time=0.1 * n), searched=False, fixed=unsure, doubt=WANDERS)
    assert len(look(known, at(time=0.9), ranges=wall(np.nan)).occluders) == 1


def test_all_is_forgotten_at_a_reset(known):
    for n in range(3):
        found = look(known, at(time=0.1 * n), AHEAD, fixed=points(*THING), ranges=wall())
    assert min(len(found.cylinders), len(found.occluders), len(found.points)) > 0
    known.reset()
    left = known.update(Detections(), at(), SURE)
    assert not len(left.cylinders)
    assert not len(left.occluders)
    assert not len(left.points)


def test_a_turn_moves_trunks_and_points_to_the_left_about_the_drone(known):
    for n in range(3):
        look(known, at(1.0, time=0.1 * n), AHEAD, fixed=points(*THING))
    known.turn(at(1.0).p, np.pi / 2)
    found = known.update(Detections(), at(1.0), SURE)
    # (5, 0) and (0.1, 3) turned about (1, 0)
    assert found.cylinders == pytest.approx(np.array([[-2.0, -0.9, 0.12], [1.0, 4.0, 0.5]]))
