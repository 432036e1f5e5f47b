"""The obstacle map look by look: what a look at a trunk moves, and by how much."""

import numpy as np
import pytest

from companion.estimation.landmark_places import Drift
from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.perception.parallax import FixedPoints
from companion.types import Trunk
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.trunk_looks import (
    LEVEL,
    MISSES,
    by_width,
    hide,
    odds,
    see,
    seen_times,
    trunk,
)


def test_a_trunk_counts_from_its_third_look_on():
    known = ObstacleMap(ObstacleConfig())
    assert [len(see(known, trunk(4.0))) for _ in range(3)] == [0, 0, 1]


def test_an_empty_map_has_rows_of_no_trunk():
    known = ObstacleMap(ObstacleConfig())
    assert known.occluders().shape == known.cylinders(np.zeros(3)).shape == (0, 3)
    assert known.doubted_cylinders(np.zeros(3)).shape == (0, 4)


def test_a_trunk_stands_in_its_level_direction_at_its_level_distance():
    """The camera sees a point 37° below it, ahead of a drone that looks north-west."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
    below = Trunk(np.array([0.0, 0.6, 0.8]), 4.0, 0.5, 0.1)
    found = see(known, below, at=(3.0, -1.0), yaw=0.75 * np.pi)
    root = np.sqrt(0.5)
    assert found == pytest.approx(np.array([[3.0 - 4.0 * root, -1.0 + 4.0 * root, 0.5, 0.1]]))


def test_the_trunk_with_the_nearest_surface_comes_first():
    known = seen_times(3, trunk(4.0, 0.0, 0.2), trunk(4.3, 1.0, 1.0))
    assert known.cylinders(np.zeros(3))[:, 2].tolist() == pytest.approx([1.0, 0.2])
    assert known.cylinders(np.array([4.0, -3.0, 2.0]))[:, 2].tolist() == pytest.approx([0.2, 1.0])


def moved(to, sigma=0.05):
    """Return the trunks that two looks at 4 m and `to` [m], in two frames, are taken for."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
    see(known, trunk(4.0, 0.0, 0.1, sigma))
    return see(known, trunk(to, 0.0, 0.1, sigma), visibility=hide)


def test_looks_in_two_frames_are_of_one_trunk_as_far_as_their_doubt_explains():
    """Of one trunk, the second look has a density; of an unknown one, that of trunks.

    Both looks have 0.05 m along and 0.08 m or a little more across the line of sight, and 0.15 m
    for the shape of the trunk. One trunk is known within 10 m.
    """
    along2 = 2.0 * 0.05**2 + 0.15**2

    def across2(to):
        return (0.02 * 4.0) ** 2 + (0.02 * to) ** 2 + 0.15**2

    def density(to):
        ways = 2.0 * np.pi * np.sqrt(along2 * across2(to))
        return np.exp(-0.5 * (to - 4.0) ** 2 / along2) / ways

    unknown = 2.0 / (np.pi * 10.0**2)
    assert density(4.60) > 1.03 * unknown
    assert density(4.62) < 0.97 * unknown
    assert moved(4.60)[:, 0] == pytest.approx([4.3])
    assert moved(4.62)[:, 0] == pytest.approx([4.0, 4.62])


@pytest.mark.parametrize(("around", "trunks"), [(0, 1), (4, 1), (30, 2)])
def test_a_doubtful_look_is_of_a_known_trunk_unless_trunks_stand_densely(around, trunks):
    """Looks of 0.4 m at 5 and 6.4 m; the others stand behind the drone, 7 m off and more."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
    others = [trunk(7.0, 2.2 + 0.06 * n, 0.1) for n in range(around)]
    see(known, trunk(5.0, 0.0, 0.1, 0.4), *others)
    found = see(known, trunk(6.4, 0.0, 0.1, 0.4), visibility=hide)
    assert len(found) - around == trunks


def test_of_two_known_trunks_a_frame_shows_each_once():
    """Both looks are nearest to the first trunk: as a pair they are of both."""
    known = seen_times(3, trunk(4.0, 0.0, 0.1, 0.3), trunk(5.0, 0.0, 0.1, 0.3))
    for order in ((4.3, 4.45), (4.45, 4.3)):
        found = see(known, *(trunk(d, 0.0, 0.1, 0.3) for d in order))
    assert found[:, 0] == pytest.approx([4.0 + 0.3 * 2 / 5, 5.0 - 0.55 * 2 / 5], abs=0.02)


def test_a_part_of_a_trunk_is_that_trunk():
    """Half of it stood behind another one: 0.5 m of radius, and its middle 0.5 m beside."""
    known = seen_times(4, trunk(4.0, 0.125, 0.5, 0.05))
    found = see(known, trunk(4.0, 0.0, 1.0, 0.05))
    assert len(found) == 1


@pytest.mark.parametrize(("apart", "trunks"), [(0.54, 1), (0.58, 2)])
def test_looks_in_one_frame_are_of_one_trunk_where_they_overlap(apart, trunks):
    """By 0.7 of the sum of their radii, 0.5 and 0.3 m."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
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
        known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
        found = see(known, trunk(4.0), turns=turns)
        assert found[0, 3] == pytest.approx(4.0 * np.hypot(0.02, 0.05))


def test_the_turn_about_the_vertical_counts_whatever_the_attitude():
    """A drone on its side that has turned to the left; its body's y axis points up."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
    q, p = np.full(4, 0.5), np.array([0.0, 0.0, 2.0])
    own = VehicleState(0.0, p, np.zeros(3), q, np.array([0.3, 5.0, 0.4]))
    known.update([Trunk(np.array([1.0, 0.0, 0.0]), 4.0, 0.5, 0.1)], own, LEVEL, 1.4)
    assert known.doubted_cylinders(p)[0, 3] == pytest.approx(4.0 * np.hypot(0.02, 0.05))


def test_the_width_of_a_trunk_counts_less_where_the_drone_turns():
    known = ObstacleMap(ObstacleConfig())
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
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
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
    left = [len(see(known, time=99.0, depth=True)) for _ in range(MISSES)]
    assert left == [1] * (MISSES - 1) + [0]


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
    """The nearer one has been seen as often, from nearer. In that frame it is not missed."""
    known = ObstacleMap(ObstacleConfig(ghosts=0.1))
    for distance in 3 * order:
        see(known, trunk(distance, 0.0, 0.5, 0.05), visibility=hide)
    assert len(known.occluders()) == 2
    found = see(known, trunk(4.5, 0.0, 0.5, 0.01), depth=True)
    assert found[:, 0] == pytest.approx([4.0], abs=0.02)
    assert known._landmarks[0].odds == pytest.approx(odds(0.2) + 4 * np.log(0.7 / 0.1))


def test_two_trunks_of_one_frame_that_meet_count_as_one_look_more():
    """They are 0.75 m apart, then by their means 0.62 m: less than 0.7 of both radii."""
    known = ObstacleMap(ObstacleConfig(ghosts=0.25))
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
    for _ in range(MISSES):
        known.see_through(p, FixedPoints.from_rows(np.array(places)))
    assert len(see(known, visibility=hide)) == left


@pytest.mark.parametrize(
    ("assumed", "shift"), [(False, 0.01 * (3.5**2 + 2.0**2) / 2.0), (True, 0.0)]
)
def test_an_unsure_tilt_leaves_open_where_a_foot_is_and_not_a_width(assumed, shift):
    """The foot of the trunk, 0.5 m nearer than its axis, is seen from 2 m up."""
    known = ObstacleMap(ObstacleConfig(ghosts=1e-3))
    found = see(known, trunk(4.0, assumed=assumed), drift=Drift(tilt=0.01))
    assert found[0, 3] == pytest.approx(np.hypot(0.1, shift))
