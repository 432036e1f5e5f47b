"""The line of sight, eq. (7): along the way, swept at random, the nearest neighbour in view."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.gaze import Gaze, GazeConfig, coming_bearing, nearest_bearing, wrap
from tests.companion.tracks import track

EAST = np.array([1.5, 0.0, 0.0])
FAR = np.array([20.0, 0.0, 0.0])
STILL = GazeConfig(sigma=0.0, survey=0.0)


def sweeping(**keys):
    """A config without the look round before the sweep."""
    return GazeConfig(survey=0.0, **keys)


def looked(config, seconds=60.0, v=EAST, to_goal=FAR, **seen):
    """ψ of each tick of a straight flight; the drone looked east before."""
    gaze = Gaze(config)
    return np.array(
        [gaze.update(k / 10, v, to_goal, 0.0, **seen) for k in range(int(seconds * 10))]
    )


@pytest.mark.parametrize("mean", [-2.5, 2.5])
def test_no_mean_sweeps_beyond_the_limit(mean):
    psi = looked(sweeping(mean=mean, sigma=0.0))
    assert np.abs(psi).max() == pytest.approx(GazeConfig().limit)


def test_without_a_sweep_the_drone_looks_along_the_way():
    assert np.allclose(looked(STILL), 0.0)


def test_the_sweep_goes_to_both_sides_within_limit_and_slew():
    psi = looked(sweeping(seed=3))
    assert psi.min() < -0.3
    assert psi.max() > 0.3
    assert np.abs(psi).max() <= GazeConfig().limit + 1e-9
    assert np.abs(np.diff(psi)).max() <= GazeConfig().slew * 0.1 + 1e-9


def test_the_sweep_depends_on_the_seed_alone():
    one, two = (looked(sweeping(seed=s)) for s in (1, 2))
    assert not np.allclose(one, two)
    assert np.array_equal(one, looked(sweeping(seed=1)))


def test_a_drone_that_must_turn_round_looks_before_it_flies():
    psi = looked(STILL, 3.0, v=np.zeros(3), to_goal=-FAR)
    assert abs(wrap(psi[-1] - math.pi)) < 1e-6


def test_the_sweep_turns_to_a_neighbour_out_of_view():
    psi = looked(sweeping(seed=3, sigma=0.1), lost=[-1.7])
    assert psi[20:].min() == pytest.approx(-0.5, abs=0.1)
    assert psi[20:].max() < 0.0


def test_a_neighbour_lost_behind_does_not_change_the_sweep():
    psi = looked(sweeping(seed=3), lost=[2.5])
    assert np.array_equal(psi, looked(sweeping(seed=3)))


@pytest.mark.parametrize("bearing", [-2.39, -1.8, -1.3, 0.0, 0.9, 1.6, 2.1, 2.39])
def test_no_swing_loses_sight_of_a_close_neighbour_or_of_the_way(bearing):
    config = sweeping(seed=3)
    psi = looked(config, close=bearing)[20:]
    off = [abs(wrap(bearing - p)) for p in psi]
    assert max(off) <= config.half_view + 1e-9
    assert np.abs(psi).max() <= config.half_view + 1e-9
    assert (
        np.abs(psi).max() <= config.limit + 1e-9 or abs(bearing) > config.half_view + config.limit
    )


def test_a_drone_at_its_goal_sweeps_on_about_where_it_looked():
    config = sweeping(seed=3, round_below=0.0)
    psi = looked(config, 30.0, v=np.zeros(3), to_goal=np.array([0.0, 0.3, 0.0]))
    assert psi.min() < -0.3
    assert psi.max() > 0.3
    assert np.abs(psi).max() <= GazeConfig().limit + 1e-9


def test_a_drone_that_stands_short_of_its_goal_looks_there():
    psi = looked(STILL, v=np.zeros(3), to_goal=np.array([0.0, 0.8, 0.0]))
    assert psi[-1] == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("bearing", [2.41, math.pi, -2.41])
def test_a_neighbour_close_behind_does_not_turn_the_look_off_the_way(bearing):
    assert np.array_equal(looked(sweeping(seed=3)), looked(sweeping(seed=3), close=bearing))


def test_before_it_sets_out_the_drone_looks_once_all_round():
    for seed in (0, 3):
        gaze = Gaze(GazeConfig(seed=seed))
        psi = [gaze.follow(0.0, 0.4)]
        while not gaze.surveyed:
            psi.append(gaze.update(len(psi) / 10, np.zeros(3), np.zeros(3), psi[-1]))
        turn = np.unwrap(psi) - 0.4
        assert np.abs(np.diff(turn)) == pytest.approx(GazeConfig().slew * 0.1)
        assert abs(turn[-1]) == pytest.approx(2 * math.pi, abs=0.2)
    gaze.follow(9.0, 0.4)
    assert not gaze.surveyed  # after a pilot has flown it, the drone looks round again


@pytest.mark.parametrize(
    ("places", "bearing"),
    [
        ([], None),
        ([(1.6, 2.0, 0.5)], 0.0),
        ([(1.0, 2.9, 0.5)], math.pi / 2),
        ([(0.5, 1.5, 0.5)], -3 * math.pi / 4),
        ([(9.0, 2.0, 0.5), (1.0, 1.5, 0.5), (0.4, 2.0, 0.5)], -math.pi / 2),
        ([(2.0, 2.0, 0.5)], None),  # 1 m away, the setting `close`
        ([(1.9, 2.0, 1.1)], None),  # nearer only as seen from above
        ([(1.0, 3.5, 0.5), (-4.0, 2.0, 0.5)], None),
    ],
)
def test_the_nearest_neighbour_has_a_bearing_where_it_is_close(places, bearing):
    tracks = [track(n, p) for n, p in enumerate(places)]
    found = nearest_bearing(np.array([1.0, 2.0, 0.5]), np.zeros(3), tracks, GazeConfig())
    assert found == (None if bearing is None else pytest.approx(bearing))


def test_how_close_is_as_configured():
    here, there = np.array([1.0, 2.0, 0.5]), [track(1, [2.5, 2.0, 0.5])]
    assert nearest_bearing(here, np.zeros(3), there, GazeConfig(close=1.6)) == 0.0
    assert nearest_bearing(here, np.zeros(3), there, GazeConfig(close=1.4)) is None


@pytest.mark.parametrize(
    ("offset", "velocity", "bearing"),
    [
        ((0.0, 5.0, 0.0), (0.0, -5.0, 0.0), math.pi / 2),  # 0.5 m away at the end of a swing
        ((0.0, 5.0, 0.0), (0.0, -4.0, 0.0), None),  # 1.4 m
        ((0.0, 5.0, 0.0), (0.0, 5.0, 0.0), None),
        # It passes 0.9 m aside; in 0.35 s, when the drone has turned, it is 0.6 m ahead.
        ((2.0, 0.9, 0.0), (-4.0, 0.0, 0.0), math.atan2(0.9, 0.6)),
        ((2.0, 1.1, 0.0), (-4.0, 0.0, 0.0), None),
        ((-0.9, 0.0, 0.0), (-4.0, 0.0, 0.0), math.pi),  # close now, and leaving
    ],
)
def test_a_neighbour_that_will_be_close_within_a_swing_is_close(offset, velocity, bearing):
    here, own = np.array([1.0, 2.0, 0.5]), np.array([0.7, -0.3, 0.1])
    coming = replace(track(1, here + offset), v=own + velocity)
    found = nearest_bearing(here, own, [coming], GazeConfig())
    assert found == (None if bearing is None else pytest.approx(bearing))


@pytest.mark.parametrize(("bearing", "turns"), [(2.15, 0.8), (-2.15, -0.8), (2.25, 0.0)])
def test_a_neighbour_counts_as_lost_up_to_where_the_widest_swing_shows_its_rim(bearing, turns):
    """0.8 rad of swing, 1.2 rad of view, and 0.2 rad of rim."""
    psi = looked(GazeConfig(survey=0.0, sigma=1e-6, seed=3), 10.0, lost=[bearing])
    assert psi[20:] == pytest.approx(turns, abs=1e-4)


def test_half_swings_alternate_sides_and_last_as_long_as_configured():
    psi = looked(sweeping(mean=0.4, sigma=0.0, seed=3), 4.0)
    ends = [psi[round(10 * t)] for t in (0.7, 1.6, 2.5, 3.4)]
    assert np.abs(ends) == pytest.approx(0.4)
    assert np.sign(ends[1:]).tolist() == (-np.sign(ends[:-1])).tolist()


@pytest.mark.parametrize(
    ("v", "to_goal", "psi"),
    [
        ([1.0, 0.0, 0.0], [0.0, 4.0, 9.0], math.atan2(1.5, 1.0)),  # a pull of 1.5 m/s
        ([1.0, 1.0, 5.0], [0.0, -0.6, 0.0], math.atan2(-0.5, 1.0)),
        ([1.0, 1.0, 0.0], [0.0, -0.5, 0.0], math.pi / 4),  # too near the goal
        ([0.0, 0.3, 0.0], [0.0, 0.0, 4.0], math.pi / 2),
        ([0.0, 0.29, 0.0], [0.4, 0.0, 0.0], 0.0),  # too slow to say a direction
    ],
)
def test_the_drone_looks_along_its_motion_and_the_pull_of_the_goal(v, to_goal, psi):
    assert looked(STILL, 3.0, np.array(v), np.array(to_goal))[-1] == pytest.approx(psi)


@pytest.mark.parametrize("bearing", [1.9, -2.2, 2.8, math.pi, -2.8])
def test_one_that_comes_from_behind_is_looked_at(bearing):
    """Whatever is close ahead; and afterwards the drone looks along its way again."""
    gaze, psi = Gaze(sweeping(seed=3)), []
    for k in range(60):
        coming = bearing if 20 <= k < 40 else None
        psi.append(gaze.update(k / 10, EAST, FAR, 0.0, lost=[0.5], close=0.4, coming=coming))
    # A swing of 0.9 s, and the turn at 2 rad/s.
    assert min(abs(wrap(bearing - p)) for p in psi[29:40]) < 0.73
    assert np.abs(wrap_all(psi[:20])).max() <= GazeConfig().limit + 1e-9
    assert np.abs(wrap_all(psi[59:])).max() <= GazeConfig().limit + 1e-9


def wrap_all(angles):
    return np.array([wrap(a) for a in angles])


@pytest.mark.parametrize("bearing", [0.0, -0.39])
def test_one_that_comes_where_every_swing_shows_it_does_not_change_the_sweep(bearing):
    assert np.array_equal(looked(sweeping(seed=3)), looked(sweeping(seed=3), coming=bearing))


@pytest.mark.parametrize("bearing", [0.7, -1.4, 1.79])
def test_one_that_comes_beside_the_way_stays_in_view_by_the_sweep(bearing):
    psi = looked(sweeping(seed=3), coming=bearing)
    assert np.abs(psi).max() <= GazeConfig().limit + 1e-9
    assert np.abs(psi[5:] - bearing).max() <= GazeConfig().half_view + 0.2
    assert np.abs(np.diff(psi[5:])).max() > 0.1  # it sweeps on


@pytest.mark.parametrize("close", [-1.6, -1.3, -1.0, 0.3])
def test_one_that_comes_from_the_other_side_is_looked_at_whoever_is_close(close):
    """It comes from 100°, where a swing within `limit` still shows it at the edge."""
    psi = looked(sweeping(seed=3), close=close, coming=1.75)
    assert np.abs(psi[20:] - 1.75).max() <= GazeConfig().half_view + 0.2


def test_a_swing_that_loses_one_that_comes_ends_at_once():
    gaze, psi = Gaze(sweeping(seed=3, half_period=5.0)), []
    for k in range(40):  # within the first swing
        away = -math.copysign(1.9, psi[-1]) if k >= 20 else None
        psi.append(gaze.update(k / 10, EAST, FAR, 0.0, coming=away))
    assert len(set(np.sign(psi[1:20]))) == 1
    assert np.sign(psi[-1]) == -np.sign(psi[19])
    assert abs(abs(psi[-1]) - (1.9 - 0.6 * GazeConfig().half_view)) < 1e-6


SLOW = np.array([0.4, 0.0, 0.0])


def rounds(psi):
    """The ticks at which a turn all round is over: so far it has turned without a pause."""
    ends, turned = [], 0.0
    for k, by in enumerate(wrap_all(np.diff(psi))):
        turned = turned + by if by * turned > 0.0 and abs(by) > 0.199 else by
        if abs(turned) > 2.0 * math.pi - 0.21:
            ends, turned = [*ends, k], 0.0
    return ends


def test_a_slow_drone_that_has_met_strangers_looks_all_round_every_few_seconds():
    ends = rounds(looked(sweeping(seed=3), 30.0, v=SLOW, strangers=True))
    assert len(ends) == 4
    assert np.diff(ends) == pytest.approx(71, abs=2)  # 4 s, and 3.1 s for the turn
    assert rounds(looked(sweeping(seed=3, strangers=True), 30.0, v=SLOW)) == ends
    assert rounds(looked(sweeping(seed=3), 30.0, v=SLOW)) == []
    assert rounds(looked(sweeping(seed=3), 30.0, v=EAST, strangers=True)) == []
    careless = sweeping(seed=3, round_below=0.3)
    assert rounds(looked(careless, 30.0, v=SLOW, strangers=True)) == []


def test_a_slow_drone_does_not_turn_away_from_one_that_comes():
    psi = looked(sweeping(seed=3), 30.0, v=SLOW, strangers=True, coming=0.2)
    assert rounds(psi) == []


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_turn_all_round_begins_to_the_side_of_one_that_comes(side):
    gaze, psi = Gaze(sweeping(seed=3)), [0.0]
    for k in range(60):
        away = psi[-1] + side * 1.7 if k >= 39 else None  # wherever it looks
        psi.append(gaze.update(k / 10, SLOW, FAR, 0.0, coming=away, strangers=True))
    assert wrap_all(np.diff(psi))[43:56] == pytest.approx(side * 0.2)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_turn_all_round_turns_back_for_one_that_comes_and_ends_at_it(side):
    gaze, yaw, ticks = Gaze(sweeping(seed=3)), [0.0], 0
    while len(yaw) < 48:  # the turn begins after 4 s
        yaw.append(gaze.update(len(yaw) / 10, SLOW, FAR, 0.0, strangers=True))
    by = wrap_all(np.diff(yaw))[-4:]
    turning = float(np.sign(by[-1]))
    assert by == pytest.approx(turning * 0.2)
    comes = yaw[-1] - turning * 1.9 * side  # behind the turn, or ahead of it
    while abs(wrap(comes - yaw[-1])) > GazeConfig().half_view:
        yaw.append(gaze.update(len(yaw) / 10, SLOW, FAR, 0.0, coming=comes, strangers=True))
        ticks += 1
        assert wrap_all(np.diff(yaw))[-1] == pytest.approx(-side * turning * 0.2)
    assert ticks == 4
    for _ in range(30):
        yaw.append(gaze.update(len(yaw) / 10, SLOW, FAR, 0.0, coming=comes, strangers=True))
        assert abs(wrap(comes - yaw[-1])) < GazeConfig().half_view + 0.2


def test_without_a_sweep_nobody_is_looked_back_at():
    assert np.allclose(looked(STILL, coming=3.0), 0.0)


def unseen(n, offset, v, seconds, sigma=0.1):
    return replace(track(n, HERE + offset, v), unseen=seconds, P=sigma**2 * np.eye(6))


HALF = math.pi / 2
HERE, OWN_V = np.array([1.0, 2.0, 0.5]), np.array([0.5, 0.0, 0.0])


@pytest.mark.parametrize(
    ("offset", "v", "seconds", "found"),
    [
        # 2.6 m of room at 1 m/s, and as if it had come for the seconds that it was not seen.
        ((-3.0, 0.0, 0.0), (1.5, 0.0, 0.0), 0.31, True),
        ((-3.5, 0.0, 0.0), (1.5, 0.0, 0.0), 0.05, False),  # in sight
        ((-3.9, 0.0, 0.0), (1.5, 0.0, 0.0), 0.4, False),
        ((-3.9, 0.0, 0.0), (1.5, 0.0, 0.0), 0.6, True),
        ((-1.0, 0.0, 0.0), (0.4, 0.0, 0.0), 2.0, False),  # it falls back
        ((0.0, 0.0, -2.0), (0.5, 0.0, 0.8), 1.0, True),  # from below
    ],
)
def test_who_may_hit_within_three_seconds_comes(offset, v, seconds, found):
    one = unseen(1, offset, v, seconds)
    at = coming_bearing(HERE, OWN_V, [one], GazeConfig())
    assert at == (pytest.approx(math.atan2(offset[1], offset[0])) if found else None)


@pytest.mark.parametrize(
    ("away", "seconds", "sigma", "found"),
    [
        (0.8, 2.0, 0.45, True),  # it may be here already
        (0.8, 2.0, 0.35, False),
        (0.8, 0.05, 0.45, False),  # in sight
        (1.3, 3.0, 0.85, False),
    ],
)
def test_one_that_may_be_here_is_looked_at_before_it_is_forgotten(away, seconds, sigma, found):
    one = unseen(1, (-away, 0.0, 0.0), (0.4, 0.0, 0.0), seconds, sigma)
    at = coming_bearing(HERE, OWN_V, [one], GazeConfig())
    assert at == (pytest.approx(math.pi) if found else None)
    assert coming_bearing(HERE, OWN_V, [one], GazeConfig(comes_within=0.0)) is None


def test_of_two_that_come_the_first_to_hit_counts():
    slow = unseen(1, (0.0, -1.6, 0.0), (0.5, 0.5, 0.0), 0.5)
    fast = unseen(2, (0.0, 2.0, 0.0), (0.5, -1.5, 0.0), 0.5)
    soon = GazeConfig(comes_within=0.5)
    assert coming_bearing(HERE, OWN_V, [slow, fast], GazeConfig()) == pytest.approx(HALF)
    assert coming_bearing(HERE, OWN_V, [slow], GazeConfig()) == pytest.approx(-HALF)
    assert coming_bearing(HERE, OWN_V, [slow, fast], soon) is None


@pytest.mark.parametrize(
    ("offset", "v", "found"),
    [
        ((0.0, 3.0, 0.0), (0.5, -1.1, 0.0), True),
        ((0.0, 4.0, 0.0), (0.5, -1.1, 0.0), False),  # not within three seconds
        ((0.0, 3.0, 0.0), (0.5, 1.1, 0.0), False),  # it leaves
    ],
)
def test_a_stranger_in_sight_comes(offset, v, found):
    one = [unseen(1, offset, v, 0.02)]
    at = coming_bearing(HERE, OWN_V, one, GazeConfig(), {1})
    assert at == (pytest.approx(math.atan2(offset[1], offset[0])) if found else None)
    assert coming_bearing(HERE, OWN_V, one, GazeConfig(), {2}) is None
