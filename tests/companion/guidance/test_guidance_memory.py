"""What guidance keeps from tick to tick: goals on the map, line of sight, landing, its reset."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.estimation.height import Height
from companion.guidance.gaze import Gaze, GazeConfig
from companion.perception.camera_health import CameraFault
from companion.perception.ground_plane import GroundPlane
from companion.types import Phase
from mavlink_bridge.wire.messages import HomePosition
from tests.companion.guidance.guided import AHEAD, HERE, decided, guiding, own, wall
from tests.companion.tracks import track

CRUISE = 1.65  # m/s
HOME = HomePosition(47.4, 8.5, 488.0, np.array([1.0, 2.0, 0.5]))

# MAP, GROUND AND FENCE

PLACE = st.floats(-3.0, 3.0)


@settings(max_examples=25)
@given(PLACE, PLACE, st.floats(-0.5, 0.5), st.lists(st.tuples(PLACE, PLACE), max_size=3))
def test_a_drone_whose_frame_is_off_the_map_flies_the_same_way_on_the_map(east, north, up, trunks):
    """Trunks are around the second goal, which is passed as a roundabout."""
    goals = [[0.0, 0.5, 2.0], [4.0, 0.0, 2.0], [4.0, 6.0, 2.0]]
    offset, on_map = np.array([east, north, up]), guiding(*goals)
    off_map = guiding(*goals)
    for step in range(4):
        here = np.array([step, 0.2 * step, 2.0])
        axes = [[4.0 + 0.4 * x, 0.4 * y, 0.3] for x, y in trunks]
        moved = [[x - east, y - north, r] for x, y, r in axes]
        there = decided(on_map, own(here), trunks=axes)
        off = decided(off_map, own(here - offset), trunks=moved, map_offset=offset)
        assert off.progress.index == there.progress.index
        assert off.progress.goal + offset == pytest.approx(there.progress.goal, abs=1e-9)
        assert off.aim + offset == pytest.approx(there.aim, abs=1e-6)
        assert off.map_offset is offset
        assert there.map_offset.tolist() == [0.0, 0.0, 0.0]


def test_a_goal_that_a_trunk_stands_at_is_flown_to_as_near_as_the_room_allows():
    """The trunk of 0.9 m, and 0.6 m beside it, cover the whole way round the goal."""
    offset = np.array([10.0, -20.0, 0.0])
    guidance = guiding([16.0, -20.0, 2.0], [16.0, -10.0, 2.0])
    reference = decided(guidance, trunks=[[6.0, 0.0, 0.9]], map_offset=offset)
    assert reference.progress.index == 0
    assert reference.progress.goal == pytest.approx([4.5, 0.0, 2.0])
    elsewhere = decided(guidance, trunks=[[16.0, -20.0, 0.9]], map_offset=offset)
    assert elsewhere.progress.goal[0] == pytest.approx(6.0, abs=0.66)


def test_a_goal_below_what_may_be_flown_is_raised_to_the_floor():
    guidance = guiding([5.0, 0.0, 0.9], fence={"ground_min": -2.0})
    assert decided(guidance).floor == pytest.approx(0.8)
    assert decided(guidance).progress.goal[2] == pytest.approx(0.9)
    up = decided(guidance, map_offset=np.array([0.0, 0.0, 1.0]))
    assert up.progress.goal[2] == pytest.approx(0.8)
    down = decided(guidance, map_offset=np.array([0.0, 0.0, -1.0]))
    assert down.progress.goal[2] == pytest.approx(1.9)
    hill = Height(1.0, 0.1, GroundPlane(1.5))
    over = decided(guidance, height=hill)
    assert over.floor == pytest.approx(2.3)
    assert over.progress.goal[2] == pytest.approx(2.3)


def test_an_error_of_the_own_height_moves_the_goals_and_not_the_fence():
    high = Height(2.0, 0.1, drift=0.4)
    guidance = guiding(AHEAD)
    reference = decided(guidance, height=high, map_offset=np.array([1.0, 0.0, 0.25]))
    assert reference.progress.goal == pytest.approx([8.0, 0.0, 2.15])
    assert reference.map_offset.tolist() == [1.0, 0.0, 0.25]
    assert reference.floor == pytest.approx(0.8)


# GOALS


@pytest.mark.parametrize(
    ("goals", "reason"),
    [
        ([[9.0, 0.0, 2.0], [9.0, 0.0, 2.0]], ""),
        ([[9.0, 0.0, 2.0], [11.5, 0.0, 2.0]], "mission.goals.1 is 2.5 m outside the fence"),
        ([[-6.2, 0.0, 2.0], [9.0, 0.0, 2.0]], "mission.goals.0 is 0.2 m outside the fence"),
        ([[9.0, 0.0, 5.0]], "mission.goals.0 is 0.5 m outside the fence"),
    ],
)
def test_goals_that_turn_out_to_be_outside_the_fence_are_named(goals, reason):
    guidance = guiding(*[{"home": g} for g in goals], fence={"east": [-5.0, 10.0]})
    assert decided(guidance, phase=Phase.WAIT, home=HOME).inhibit_reason == reason


def test_goals_from_home_wait_for_it_and_move_with_it_until_the_mission_begins():
    guidance = guiding({"home": [4.0, 0.0, 1.5]})
    waits = decided(guidance, phase=Phase.WAIT)
    assert waits.inhibit_reason == "mission.goals: the vehicle has not told its home position yet"
    assert decided(guidance).progress.goal.tolist() == HERE
    assert decided(guidance, phase=Phase.WAIT, home=HOME).inhibit_reason == ""
    assert decided(guidance, home=HOME).progress.goal.tolist() == [5.0, 2.0, 2.0]
    moved = replace(HOME, p=np.array([2.0, 2.0, 0.5]))
    assert decided(guidance, home=moved).progress.goal.tolist() == [5.0, 2.0, 2.0]
    assert decided(guidance, phase=Phase.WAIT, home=moved).inhibit_reason == ""
    assert decided(guidance, home=moved).progress.goal.tolist() == [6.0, 2.0, 2.0]


@pytest.mark.parametrize(
    "goals",
    [
        [HERE, AHEAD],
        [{"home": [-1.0, -2.0, 1.5]}, {"home": [8.0, -2.0, 1.5]}],
        [{"home": [-1.0, -2.0, 1.5]}, AHEAD],
    ],
)
def test_a_mission_that_is_broken_off_goes_on_where_it_was(goals):
    guidance, later = guiding(*goals), own([4.0, 0.0, 2.0])
    decided(guidance, phase=Phase.WAIT, home=HOME)
    assert decided(guidance, home=HOME).progress.index == 1  # the drone begins at the first goal
    decided(guidance, later, phase=Phase.PASSIVE, home=HOME)
    assert decided(guidance, later, home=HOME).progress.index == 1


def test_goals_on_the_map_take_no_notice_of_home():
    guidance, later = guiding(HERE, AHEAD), own([4.0, 0.0, 2.0])
    assert decided(guidance).progress.index == 1
    decided(guidance, later, phase=Phase.PASSIVE, home=HOME)
    assert decided(guidance, later, home=HOME).progress.index == 1


def test_new_goals_take_the_place_of_all_others():
    guidance = guiding({"home": [4.0, 0.0, 1.5]})
    assert decided(guidance, phase=Phase.WAIT).inhibit_reason
    guidance.set_goals([np.array([0.0, 5.0, 2.5]), np.array([0.0, 9.0, 2.5])])
    assert decided(guidance, phase=Phase.WAIT, home=HOME).inhibit_reason == ""
    reference = decided(guidance, home=HOME)
    assert reference.progress.goal == pytest.approx([0.0, 5.0, 2.5], abs=0.66)
    assert reference.progress.index == 0
    guidance.set_goals([np.array([3.0, 0.0, 2.0])])
    assert decided(guidance).progress.goal.tolist() == [3.0, 0.0, 2.0]


def test_an_opening_is_found_where_it_is_seen():
    """The map says 1.1 m too far left; the goal is behind the wall."""
    goal = {"place": [4.0, 1.0, 2.0], "opening": True}
    offset, at = np.array([0.0, -0.2, 0.0]), own([0.0, 1.2, 2.0])
    guidance = guiding(goal, [9.0, 0.0, 2.0])
    seen = decided(guidance, at, points=wall(-0.9, 1.1), map_offset=offset).progress.goal
    assert seen == pytest.approx([4.0, 0.1, 2.0], abs=0.15)
    remembered = decided(guidance, at, map_offset=offset).progress.goal
    assert remembered.tolist() == seen.tolist()
    blind = decided(guiding(goal, [9.0, 0.0, 2.0]), at, map_offset=offset).progress.goal
    assert blind == pytest.approx([4.0, 1.2, 2.0])


# LINE OF SIGHT


def test_while_another_flies_the_drone_looks_where_it_looks():
    guidance = guiding(AHEAD, gaze={})
    assert decided(guidance, own(yaw=1.3), phase=Phase.PASSIVE).yaw == pytest.approx(1.3)
    assert decided(guidance, own(yaw=-2.0, time=0.1), phase=Phase.ENGAGE).yaw == pytest.approx(-2.0)


def test_the_line_of_sight_begins_where_the_drone_looks_and_turns_once_round_first():
    guidance = guiding(AHEAD, gaze={"seed": 3})
    decided(guidance, own(yaw=1.0), phase=Phase.ENGAGE)
    yaws = [1.0]
    for k in range(1, 32):
        reference = decided(guidance, own(yaw=yaws[-1], time=0.1 * k))
        assert reference.progress.goal.tolist() == HERE
        yaws.append(reference.yaw)
    turned = np.diff(np.unwrap(yaws))
    assert np.abs(turned) == pytest.approx(0.2)
    assert abs(turned.sum()) == pytest.approx(6.2)
    for k in range(32, 35):
        reference = decided(guidance, own(yaw=yaws[-1], time=0.1 * k))
    assert reference.progress.goal.tolist() == AHEAD
    # Where a pilot takes over, the next mission begins with a look round again.
    decided(guidance, own(time=3.6), phase=Phase.PASSIVE)
    first, second = (decided(guidance, own(time=t)).yaw for t in (3.7, 3.8))
    assert abs(second - first) == pytest.approx(0.2)


def looked(tracks, config, at):
    """The line of sight of ten ticks by guidance, and by its gaze alone with what it is told."""

    def both(lost, close):
        guidance, gaze = guiding(AHEAD, gaze=config), Gaze(GazeConfig(**config))
        ours, theirs = [], []
        for k in range(20):
            here = replace(at, time=0.1 * k)
            ours.append(decided(guidance, here, tracks=tracks).yaw)
            to_aim = np.array(AHEAD) - here.p
            theirs.append(gaze.update(here.time, here.v, to_aim, 0.0, lost, close))
        return ours, theirs

    return both


SWEEP = {"survey": 0.0, "sigma": 0.1, "seed": 3}


def test_the_sweep_is_about_the_way_to_the_aim_and_the_motion():
    ours, theirs = looked([], SWEEP, own(v=[0.5, 1.0, 0.0]))([], None)
    assert ours == pytest.approx(theirs)
    assert np.mean(theirs) > 0.2


def test_the_sweep_turns_to_critical_neighbours_out_of_sight_the_worst_first():
    lost = [
        replace(track(1, [0.0, -3.0, 2.0]), unseen=1.0),
        replace(track(2, [-0.3, 2.0, 2.0]), unseen=1.0),
        track(3, [2.0, 2.0, 2.0]),
    ]
    ours, theirs = looked(lost, SWEEP, own())([math.pi - math.atan2(2.0, 0.3), -math.pi / 2], None)
    assert ours == pytest.approx(theirs)
    assert max(theirs) > 0.3
    seen, _ = looked([replace(t, unseen=0.0) for t in lost], SWEEP, own())([], None)
    assert max(seen) < 0.3


def test_a_neighbour_out_of_sight_that_is_not_critical_does_not_turn_the_sweep():
    near = [track(n, [-0.2 * n, 1.2, 2.0], [0.2, 0.0, 0.0]) for n in range(3)]
    far = [replace(track(9, [0.0, -6.0, 2.0]), unseen=1.0)]
    ours, theirs = looked(near + far, SWEEP, own())([], None)
    assert ours == pytest.approx(theirs)


def test_the_nearest_neighbour_stays_in_view_where_it_is_close():
    close = [track(1, [0.9, -3.0, 2.0]), track(2, [-0.2, -0.7, 2.0])]
    ours, theirs = looked(close, SWEEP, own())([], math.atan2(-0.7, -0.2))
    assert ours == pytest.approx(theirs)
    assert theirs[-1] < -0.4


def test_a_reset_forgets_where_the_drone_looked_and_not_where_the_mission_is():
    guidance = guiding(HERE, AHEAD)
    assert decided(guidance).progress.index == 1
    guidance.reset()
    reference = decided(guidance, own([4.0, 0.0, 2.0], yaw=2.5, time=500.0))
    assert reference.progress.index == 1
    assert reference.yaw == pytest.approx(2.5)


def test_a_reset_asks_for_a_look_round_anew():
    guidance = guiding(AHEAD, gaze={"sigma": 0.0}, mission={"land_wait": 5.0})
    for k in range(40):
        decided(guidance, own(time=0.1 * k))
    assert decided(guidance, own(time=4.0)).progress.goal.tolist() == AHEAD
    guidance.reset()
    assert decided(guidance, own(time=4.1)).progress.goal.tolist() == HERE


# LANDING


def test_the_drone_lands_at_its_last_goal_while_it_flies_itself():
    guidance = guiding(AHEAD)
    assert not decided(guidance).land
    there = own([8.8, 0.0, 2.0])
    reference = decided(guidance, there)
    assert reference.progress.complete
    assert reference.land
    assert decided(guidance, there, phase=Phase.LAND).land
    assert not decided(guidance, there, phase=Phase.PASSIVE).land
    assert not decided(guidance, there, phase=Phase.ENGAGE).land


def test_before_it_lands_the_drone_looks_round_and_waits_for_a_neighbour_below():
    guidance = guiding(AHEAD, gaze={"sigma": 0.0}, mission={"land_wait": 20.0})
    below = [track(1, [9.0, 0.0, 1.0])]
    yaws, landed, time = [0.0], None, 0.0
    decided(guidance, own(), phase=Phase.ENGAGE)
    for _ in range(40):  # the look round before it sets out
        time += 0.1
        decided(guidance, own(time=time))
    arrived = time
    while landed is None and time < 60.0:
        time += 0.1
        there = own(AHEAD, yaw=yaws[-1], time=time)
        reference = decided(guidance, there, tracks=below if time < arrived + 8.0 else [])
        yaws.append(reference.yaw)
        landed = time if reference.land else None
    assert landed - arrived == pytest.approx(8.0, abs=0.15)
    turned = np.abs(np.diff(np.unwrap(yaws)))
    assert turned.sum() == pytest.approx(2.0 * math.pi, abs=0.5)


def test_a_neighbour_below_but_aside_by_the_distance_of_safety_is_no_reason_to_wait():
    guidance = guiding(AHEAD, mission={"land_wait": 20.0})
    there = own(AHEAD)
    assert not decided(guidance, there, tracks=[track(1, [9.0, 0.75, 1.0])]).land
    assert decided(guidance, there, tracks=[track(1, [9.0, 0.85, 1.0])]).land


def test_new_goals_after_a_landing_begin_a_landing_of_their_own():
    guidance = guiding(AHEAD, mission={"land_wait": 5.0})
    below = [track(1, [9.0, 0.0, 1.0])]
    assert not decided(guidance, own(AHEAD), tracks=below).land
    assert decided(guidance, own(AHEAD, time=5.0), tracks=below).land
    guidance.set_goals([np.array(AHEAD)])
    assert not decided(guidance, own(AHEAD, time=6.0), tracks=below).land


def test_a_reset_begins_a_landing_anew():
    guidance = guiding(AHEAD, mission={"land_wait": 5.0})
    below = [track(1, [9.0, 0.0, 1.0])]
    assert not decided(guidance, own(AHEAD), tracks=below).land
    assert decided(guidance, own(AHEAD, time=5.0), tracks=below).land
    guidance.reset()
    assert not decided(guidance, own(AHEAD, time=6.0), tracks=below).land


# COMMISSIONING


def test_a_commissioning_flight_has_its_own_goals_and_line_of_sight_and_no_limit_by_view():
    offset = np.array([1.0, -2.0, 0.5])
    guidance = guiding(mission={"commission": True})
    decided(guidance, own(time=9.9), phase=Phase.ENGAGE, map_offset=offset)
    begins = decided(guidance, own(yaw=0.3, time=10.0), map_offset=offset)
    assert begins.progress.goal == pytest.approx(HERE)
    assert begins.yaw == pytest.approx(0.3)
    left = decided(guidance, own(yaw=0.3, time=17.5), map_offset=offset)
    assert left.progress.goal == pytest.approx([-0.8 * math.sin(0.3), 0.8 * math.cos(0.3), 2.0])
    assert left.yaw == pytest.approx(0.3 + 0.8 * math.sin(0.6 * math.pi * 5.5))
    assert (left.speed, left.speed_limit) == (CRUISE, "cruise")
    back = decided(guidance, own(yaw=0.3, time=14.0), map_offset=offset, fault=CameraFault.DEAD)
    assert (back.speed, back.speed_limit) == (0.4, "camera")
