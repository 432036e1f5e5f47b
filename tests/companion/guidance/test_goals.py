"""Goals in the own frame, from home and on the Earth, as a configuration says them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.height import HeightEstimator
from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.goals import GoalConfig, resolved
from companion.guidance.guidance import Guidance
from companion.guidance.mission import MissionConfig
from companion.perception.camera_health import CameraFault
from companion.settings.config import CompanionConfig
from companion.types import Phase
from mavlink_bridge.shared.settings import SettingsError, parse_yaml, validate
from mavlink_bridge.wire.ids import SensorRotation
from mavlink_bridge.wire.messages import DistanceSensor, HomePosition
from tests.companion.depth_images import state

SOON = Delay(0.06, 0.003)
HOME = HomePosition(47.3977, 8.5456, 488.0, np.array([1.0, 2.0, 0.5]))


def mission(text):
    return validate(MissionConfig, parse_yaml(text, "m.yaml"), "m.yaml")


def test_a_list_is_a_place_in_the_own_frame():
    goals = mission("goals: [[4, 0, 2], {place: [0, 0, 2]}]").goals
    assert [g.p.tolist() for g in resolved(goals, None)] == [[4, 0, 2], [0, 0, 2]]


def test_a_goal_from_home_waits_for_the_home_and_counts_from_it():
    goals = mission("goals: [{home: [10, -5, 3]}]").goals
    assert resolved(goals, None) is None
    assert resolved(goals, HOME)[0].p.tolist() == [11.0, -3.0, 3.5]


def test_a_goal_on_the_earth_lies_where_a_geodesic_says():
    # 0.001° of latitude, and of longitude at 47.4°: 111.19 m and 75.27 m on PX4's sphere.
    goals = mission("goals: [{latitude: 47.3987, longitude: 8.5466, height: 20}]").goals
    p = resolved(goals, HOME)[0].p - HOME.p
    assert p == pytest.approx([111.195 * math.cos(math.radians(47.3977)), 111.195, 20.0], abs=0.01)


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("[1, 2]", "must be [x, y, z], got [1.0, 2.0]"),
        ("{place: [0, 0, 2], home: [0, 0, 2]}", "must be one of [x, y, z], {place"),
        ("{latitude: 47.0, longitude: 8.0}", "must be one of [x, y, z], {place"),
        ("{latitude: 97.0, longitude: 8.0, height: 3}", "latitude: must be ≥ -90, ≤ 90"),
        ("{lat: 47.0}", "lat"),
        ("3", "goals.0"),
    ],
)
def test_a_goal_that_says_nothing_is_refused_with_its_line(goal, message):
    with pytest.raises(SettingsError) as refused:
        mission(f"tolerance: 1\ngoals:\n  - {goal}\n")
    assert "m.yaml:3" in str(refused.value)
    assert message in str(refused.value)


def test_an_opening_is_kept_with_its_goal():
    goals = mission("goals: [{place: [0, 3, 2], opening: true}, [0, 9, 2]]").goals
    assert [g.opening for g in resolved(goals, None)] == [True, False]


def test_an_editor_is_told_both_ways_of_writing_a_goal():
    goals = CompanionConfig.model_json_schema()["$defs"]["GoalConfig"]["anyOf"]
    assert {g.get("type") for g in goals} == {"array", "object"}


def test_goals_move_with_the_home():
    goal = GoalConfig(home=[1.0, 0.0, 2.0])
    moved = replace(HOME, p=np.array([5.0, 0.0, 0.0]))
    assert goal.at(moved).tolist() == [6.0, 0.0, 2.0]


@pytest.mark.parametrize(("doubt", "share"), [(0.05, 0.03), (0.5, 0.74)])
def test_goals_move_with_the_ground_where_the_own_height_is_in_doubt(doubt, share):
    """With GPS drones whose heights wandered flew above each other, out of each other's view."""
    config = CompanionConfig.model_validate(
        {"mission": {"goals": [[30.0, 0.0, 2.0]]}, "log": {"path": "flight.mcap"}}
    )
    guidance, estimator = Guidance(config.guidance()), HeightEstimator()
    for k in range(200):  # one metre more than it is high: by a rangefinder
        own = state([0.0, 0.0, 3.0], time=0.1 * k)
        look = DistanceSensor(own.time, 2.0, 0.1, 12.0, SensorRotation.DOWN, 0)
        height = estimator.update(own, [look], doubt)
        reference = guidance.decide(
            own, [], KnownObstacles(), CameraFault.NONE, Phase.FLY, delay=SOON, height=height
        )
    assert height.drift == pytest.approx(share, abs=0.01)
    assert reference.progress.goal[2] == pytest.approx(2.0 + share, abs=0.01)
    assert reference.progress.index == 0
