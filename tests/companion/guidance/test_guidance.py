"""What guidance decides in one tick: places, the rules that move them, speed and neighbours."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.known_obstacles import KnownObstacles
from companion.perception.camera_health import CameraFault
from companion.types import Phase
from tests.companion.guidance.guided import AHEAD, HERE, SOON, decided, guiding, own, wall
from tests.companion.tracks import track

CRUISE, V_MAX = 1.65, 1.85  # m/s


def test_without_an_own_state_there_is_no_reference():
    known = KnownObstacles()
    assert guiding(AHEAD).decide(None, [], known, CameraFault.NONE, Phase.FLY) is None


@pytest.mark.parametrize("phase", Phase)
def test_the_mission_goes_on_in_flight_alone_else_the_reference_is_to_stay(phase):
    guidance = guiding(AHEAD)
    reference = decided(guidance, own(yaw=2.0), phase=phase)
    flies = phase in (Phase.FLY, Phase.LAND)
    for place in (reference.progress.goal, reference.aim, reference.target):
        assert place.tolist() == (AHEAD if flies else HERE)
    assert reference.progress.index == 0
    assert not reference.progress.complete
    assert not reference.land
    assert reference.route == ()


def test_a_drone_that_has_others_looks_round_until_it_has_seen_one_and_then_sets_out():
    turning = {"survey": 2 * math.pi, "sigma": 0.0, "slew": 2.0}
    guidance = guiding(AHEAD, gaze=turning, mission={"others": True})
    turned, yaw = 0.0, 0.0
    for k in range(60):  # 6 s, two turns on the spot
        reference = decided(guidance, own(yaw=yaw, time=0.1 * k))
        assert reference.alone
        assert reference.progress.goal.tolist() == HERE
        turned += abs(math.remainder(reference.yaw - yaw, 2 * math.pi))
        yaw = reference.yaw
    assert turned > 3.5 * math.pi
    one = [track(1, [0.0, 5.0, 2.0])]
    assert decided(guidance, own(yaw=yaw, time=5.95), tracks=one, steady=False).alone
    for k in range(60, 97):  # to the end of the third turn: seen in the midst of it is not enough
        seen = one if 66 <= k < 85 else []
        reference = decided(guidance, own(yaw=yaw, time=0.1 * k), tracks=seen)
        assert reference.alone
        yaw = reference.yaw
    for k in range(97, 131):
        reference = decided(guidance, own(yaw=yaw, time=0.1 * k), tracks=one)
        yaw = reference.yaw
    assert not reference.alone
    assert reference.progress.goal.tolist() == AHEAD


def test_without_others_a_drone_waits_for_nobody():
    reference = decided(guiding(AHEAD))
    assert not reference.alone
    assert reference.progress.goal.tolist() == AHEAD


# SPEED


@pytest.mark.parametrize(
    ("limit", "speed", "situation"),
    [
        ("cruise", CRUISE, {}),
        ("cruise", CRUISE, {"at": own(yaw=0.7)}),
        ("visibility", 0.5 * CRUISE, {"at": own(yaw=1.05)}),
        ("visibility", 0.1 * CRUISE, {"at": own(yaw=math.pi)}),
        # 3 m of room last for 1.5 s.
        ("headway", 1.0, {"tracks": [track(1, [2.6, 0.0, 2.0])]}),
        ("cruise", CRUISE, {"tracks": [track(1, [2.6, 0.0, 2.0], [1.0, 0.0, 0.0])]}),
        ("reaction", 0.75, {"delay": Delay(0.3, 0.05)}),
        ("cruise", CRUISE, {"surprises": 1}),
        ("surprises", CRUISE / 3, {"surprises": 3}),
        ("surprises", 0.4, {"surprises": 9}),
        ("cruise", CRUISE, {"clear_share": 0.5}),
        ("clear finds", CRUISE / 2, {"clear_share": 0.25}),
        ("clear finds", 0.4, {"clear_share": 0.1}),
        ("camera", 0.4, {"fault": CameraFault.DEAD}),
        ("camera", 0.4, {"fault": CameraFault.SENSELESS, "delay": Delay(0.3, 0.05)}),
        ("visibility", 0.1 * CRUISE, {"fault": CameraFault.DEAD, "at": own(yaw=math.pi)}),
        ("reaction", 0.3, {"fault": CameraFault.DEAD, "delay": Delay(0.9, 0.05)}),
    ],
)
def test_the_lowest_limit_gives_the_speed_and_its_name(limit, speed, situation):
    reference = decided(guiding(AHEAD), **situation)
    assert reference.speed == pytest.approx(speed)
    assert reference.speed_limit == limit


def test_the_limits_are_those_of_the_configuration():
    limits = {
        "headway": 3.0,
        "clearance": 0.6,
        "no_view_share": 0.5,
        "reaction_way": 0.15,
        "surprises": 2,
    }
    slow = {"speed_limits": limits, "guard": {"blind_speed": 0.2}}
    near = [track(1, [2.6, 0.0, 2.0])]
    assert decided(guiding(AHEAD, **slow), tracks=near).speed == pytest.approx(2.0 / 3.0)
    assert decided(guiding(AHEAD, **slow), own(yaw=3.0)).speed == pytest.approx(0.5 * CRUISE)
    assert decided(guiding(AHEAD, **slow), delay=Delay(0.2, 0.05)).speed == pytest.approx(0.5)
    assert decided(guiding(AHEAD, **slow), surprises=4).speed == pytest.approx(CRUISE / 2)
    assert decided(guiding(AHEAD, **slow), fault=CameraFault.DEAD).speed == 0.2


def test_a_neighbour_out_of_range_or_on_another_level_is_no_headway():
    short = {"threat": {"range_max": 2.0}}
    assert decided(guiding(AHEAD, **short), tracks=[track(1, [2.6, 0, 2])]).speed == CRUISE
    low = {"right_of_way": {"level": 0.3}}
    assert decided(guiding(AHEAD, **low), tracks=[track(1, [2.6, 0, 1.5])]).speed == CRUISE


def test_speed_is_limited_on_the_way_round_and_not_on_the_way_to_the_goal():
    """Its view is along the aim: two trunks, of which the gap is closed, send it aside."""
    pair = [[2.0, 0.6, 0.3], [2.0, -0.2, 0.3], [2.0, 1.4, 0.3], [2.0, -1.0, 0.3]]
    reference = decided(guiding(AHEAD), trunks=pair)
    off = abs(math.atan2(reference.aim[1], reference.aim[0]))
    assert off > 0.75
    assert reference.speed == pytest.approx(CRUISE * (1.4 - off) / 0.7)


@pytest.mark.parametrize(
    ("delay", "bound"), [(SOON, V_MAX), (Delay(0.3, 0.05), V_MAX * 0.75 / CRUISE)]
)
def test_a_drone_that_reacts_late_has_a_lower_bound_of_all_speeds(delay, bound):
    assert decided(guiding(AHEAD), delay=delay).v_max == pytest.approx(bound)


def test_near_a_neighbour_no_speed_is_much_above_its_own():
    near = [track(1, [0.0, 1.4, 2.0], [0.3, 0.0, 0.0])]
    assert decided(guiding(AHEAD), tracks=near).v_max == pytest.approx(0.8 + 0.3 + 0.3)
    behind = [replace(track(1, [0.0, -1.1, 2.0], [1.0, 0.0, 0.0]), unseen=0.6)]
    # Of one out of sight, the speed that is flown.
    assert decided(guiding(AHEAD), tracks=behind).v_max == pytest.approx(CRUISE)


# NEIGHBOURS


def test_neighbours_in_range_come_worst_first_and_the_first_few_are_critical():
    tracks = [track(n, [0.0, float(n), 2.0]) for n in (5, 3, 1, 4, 2, 11)]
    reference = decided(guiding(AHEAD), tracks=tracks)
    assert [t.id for t, _ in reference.near] == [1, 2, 3, 4, 5]
    assert reference.critical == reference.near[:3]
    # Its least closing speed, at a distance of 1 m where 2 m is the distance of reference.
    assert reference.near[0][1] == pytest.approx(0.6 * math.e)


def test_critical_neighbours_that_fly_the_same_way_are_cohesive_and_those_in_the_way_are_not():
    along = track(1, [1.5, 0.8, 2.0], [1.0, 0.0, 0.0])
    stands, beside = track(2, [3.0, 0.3, 2.0]), track(3, [-0.5, -2.0, 2.0])
    far = track(4, [-4.0, 2.0, 2.0], [1.0, 0.0, 0.0])
    reference = decided(guiding(AHEAD), tracks=[along, stands, beside, far])
    assert {t.id for t, _ in reference.critical} == {1, 2, 3}
    assert reference.cohesive == {1, 3}


def test_an_oncoming_neighbour_turns_the_target_to_the_right_and_not_the_aim():
    oncoming = [track(1, [4.0, 0.0, 2.0], [-1.0, 0.0, 0.0])]
    reference = decided(guiding(AHEAD), tracks=oncoming)
    assert reference.aim.tolist() == AHEAD
    # 1 m of room at 4 m: the goal 9 m ahead moves on its circle.
    turn = math.atan2(1.0, 4.0)
    assert reference.target == pytest.approx([9.0 * math.cos(turn), -9.0 * math.sin(turn), 2.0])
    assert reference.route == ("right of way",)


def test_without_a_passage_on_the_right_it_is_passed_on_the_left():
    oncoming = [track(1, [4.0, 0.0, 2.0], [-1.0, 0.0, 0.0])]
    reference = decided(guiding(AHEAD), tracks=oncoming, trunks=[[4.0, -1.5, 0.5]])
    assert reference.target[1] > 1.0
    assert reference.route == ("right of way",)


def test_room_for_an_oncoming_neighbour_is_as_configured():
    oncoming = [track(1, [4.0, 0.0, 2.0], [-1.0, 0.0, 0.0])]
    never = {"right_of_way": {"keep_right": 0.0}}
    reference = decided(guiding(AHEAD, **never), tracks=oncoming)
    assert reference.target.tolist() == AHEAD
    assert reference.route == ()
    wide = decided(guiding(AHEAD, right_of_way={"keep_right": 1.8}), tracks=oncoming)
    assert math.atan2(-wide.target[1], wide.target[0]) == pytest.approx(math.atan2(1.8, 4.0))


# OBSTACLES

# Four trunks in a row across the way, with too little room between them; the nearer end is right.
HEDGE = [[3.0, y, 0.3] for y in (-1.0, -0.1, 0.8, 1.7)]


def test_a_closed_row_of_trunks_is_flown_round_at_its_nearer_end():
    reference = decided(guiding(AHEAD), trunks=HEDGE)
    assert reference.route == ("detour",)
    assert reference.progress.goal.tolist() == AHEAD
    assert reference.aim[1] / reference.aim[0] < -0.4
    assert reference.target.tolist() == reference.aim.tolist()


def test_the_room_beside_trunks_is_that_of_the_configuration():
    """0.9 m from surface to surface, of 1.2 m that are needed by default."""
    pair = [[3.0, 0.75, 0.3], [3.0, -0.75, 0.3]]
    assert decided(guiding(AHEAD), trunks=pair).route == ("detour",)
    narrow = {"nmpc": {"d_obstacle_safety": 0.44}}
    assert decided(guiding(AHEAD, **narrow), trunks=pair).route == ()


@pytest.mark.row("21")
def test_outside_the_fence_the_way_leads_back():
    outside = own([10.4, 0.0, 2.0])
    guidance = guiding([9.0, 0.0, 2.0], fence={"east": [-5.0, 10.0]})
    guidance.set_goals([np.array([30.0, 1.0, 2.0])])
    d = guidance._settings.d_obstacle
    reference = decided(guidance, at=outside)
    assert reference.route == ("fence",)
    assert reference.aim == pytest.approx([10.0 - d, 1.0, 2.0])
    on_map = decided(guidance, at=own([0.4, 0.0, 2.0]), map_offset=np.array([10.0, 0.0, 0.0]))
    assert on_map.aim == pytest.approx([-d, 1.0, 2.0])  # the fence is on the map
    assert decided(guidance, at=own([9.9, 0.0, 2.0])).route == ()


def test_the_way_round_stays_within_the_fence():
    fence = {"fence": {"north": [-2.0, 9.0], "east": [-5.0, 20.0]}}
    reference = decided(guiding(AHEAD, **fence), trunks=HEDGE)
    assert reference.aim[1] / reference.aim[0] > 0.4


def test_the_side_once_taken_is_kept_until_the_reset():
    guidance = guiding(AHEAD)
    assert decided(guidance, trunks=HEDGE).aim[1] < 0.0
    to_the_left = own([0.0, 1.5, 2.0], time=0.1)
    kept = decided(guidance, to_the_left, trunks=HEDGE)
    assert kept.aim[1] < 1.5
    guidance.reset()
    assert decided(guidance, to_the_left, trunks=HEDGE).aim[1] > 1.5
    assert decided(guiding(AHEAD), to_the_left, trunks=HEDGE).aim[1] > 1.5


def test_before_a_wall_the_drone_flies_to_where_it_is_open():
    reference = decided(guiding(AHEAD), points=wall(0.3, 2.3))
    assert reference.route == ("walls",)
    turn = math.atan2(reference.aim[1], reference.aim[0])
    assert 0.2 < turn <= 0.4
    assert math.hypot(*reference.aim[:2]) == pytest.approx(9.0)
    assert reference.aim[2] == 2.0
    assert decided(guiding(AHEAD), points=wall(-1.0, 1.0)).route == ()


def test_a_way_past_walls_leaves_the_distance_to_obstacles_less_their_roughness():
    """The wall ends 0.52 m to the right: 0.5 m are asked for, 0.6 m less 0.1 m."""
    right = wall(-0.52, 1.5)
    assert decided(guiding(AHEAD), points=right).route == ()
    rough = {"surfaces": {"rough": 0.0}}
    assert decided(guiding(AHEAD, **rough), points=right).route == ("walls",)
    short = {"surfaces": {"rough": 0.0, "range": 2.9}}
    assert decided(guiding(AHEAD, **short), points=right).route == ()


def test_the_solver_gets_what_stands_around_and_the_free_room_towards_the_aim():
    points = wall(0.3, 2.3)
    reference = decided(guiding(AHEAD), trunks=[[1.0, -3.0, 0.2]], points=points)
    assert reference.obstacles.cylinders.tolist() == [[1.0, -3.0, 0.2]]
    assert reference.obstacles.sigmas.tolist() == [0.1]
    assert len(reference.obstacles.points) == len(points)
    planes = reference.obstacles.planes
    assert 1 <= len(planes) <= 4
    inside = np.array(HERE) @ planes[:, :3].T < planes[:, 3]
    assert inside.all()
    none = decided(guiding(AHEAD, surfaces={"planes": 0}), points=points)
    assert none.obstacles.planes.shape == (0, 4)


def test_the_rules_that_move_the_target_come_in_their_order():
    oncoming = [track(1, [2.0, 0.8, 2.0], [-1.0, -0.4, 0.0])]
    reference = decided(guiding(AHEAD), tracks=oncoming, points=wall(0.3, 2.3))
    assert reference.route == ("walls", "right of way")


def test_one_that_gives_no_way_is_named_and_a_slow_drone_then_looks_all_round():
    guidance = guiding(AHEAD, gaze={"survey": 0.0})
    turned, yaw = 0.0, 0.0
    for k in range(80):
        x = HERE[0] + 2.0 - 0.1 * k
        comes = [track(5, [x, HERE[1], HERE[2]], [-1.0, 0.0, 0.0])] if k < 10 else []
        reference = decided(guidance, own(yaw=yaw, time=0.1 * k), tracks=comes)
        assert reference.strangers == (frozenset() if k < 4 else {5})
        turned += abs(math.remainder(reference.yaw - yaw, 2 * math.pi))
        yaw = reference.yaw
    assert turned > 2.0 * math.pi
    phase = decided(guidance, own(yaw=yaw, time=8.0), phase=Phase.TAKEOFF)
    assert phase.strangers == frozenset()
