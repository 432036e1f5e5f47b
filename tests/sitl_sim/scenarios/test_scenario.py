"""Scenarios as data: seeded, with free starts and targets, refused where impossible."""

import json
import re

import numpy as np
import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.world import surface_distance

MISSIONS = {
    "drone_radius": 0.15,
    "missions": {
        str(n): {
            "cylinders": [[0.0, 0.1 * n, 0.2]],
            "agents": [
                {"start": [3.0, 1.5 * k, 1.0], "goal": [-3.0, 1.5 * k, 1.0]} for k in range(20)
            ],
        }
        for n in (1, 2)
    },
}


@pytest.fixture
def missions(tmp_path):
    file = tmp_path / "missions.json"
    file.write_text(json.dumps(MISSIONS))
    return file


def load(name, seed, missions, *overrides):
    extra = [f"world.missions={missions}"] if name == "lsc-forest" else []
    return scenarios.load(name, [*extra, f"seed={seed}", *overrides])


def apart(points):
    d = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return (d + 1e3 * np.eye(len(points))).min()


@pytest.mark.parametrize("name", scenarios.names())
def test_starts_and_targets_are_free_and_apart_with_any_seed(name, missions):
    for seed in range(5):
        s = load(name, seed, missions)
        world, start = build(s.world, s.seed), placement.starts(s)
        goals = placement.targets(s, start)
        assert len(start) == s.drones.count == len(goals)
        assert apart(start) > 1.1
        up = start + np.array([0, 0, s.mission.altitude])
        assert surface_distance(up, world).min() > 0.8
        assert surface_distance(np.array([g for v in goals.values() for g in v]), world).min() > 0.8
        if (
            s.mission.targets_of or s.mission.exchange or s.mission.spread
        ):  # one's own, where the flight ends
            assert apart(np.array([v[-1] for v in goals.values()])) > 1.1


@pytest.mark.parametrize("name", scenarios.names())
def test_the_seed_alone_varies_world_and_starts(name, missions):
    def flown(seed):
        s = load(name, seed, missions)
        return build(s.world, s.seed), placement.starts(s).tolist()

    assert flown(3) == flown(3)
    assert flown(3) != flown(4)


def test_drones_face_their_first_target():
    s = scenarios.load("circle", ["seed=1"])
    start = placement.starts(s)
    inward = -start[:, :2] / np.linalg.norm(start[:, :2], axis=1)[:, None]
    yaw = placement.headings(s, start)
    assert (np.column_stack([np.cos(yaw), np.sin(yaw)]) * inward).sum(axis=1).min() > 0.999


def test_a_mission_comes_from_the_file_that_the_user_names(missions):
    s = load("lsc-forest", 3, missions, "drones.count=4")
    assert [c.y for c in s.world.cylinders] == [0.2]  # the second of two
    assert s.drones.radius == 0.15
    start = placement.starts(s)
    assert start[:, 1].tolist() == [0.0, 1.5, 3.0, 4.5]
    assert placement.targets(s, start)["drone2"] == [[-3.0, 1.5, 1.0]]
    # What is written into the run folder stands by itself.
    assert scenarios.Scenario.model_validate(s.model_dump()) == s


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("mission.targets=[[1.0, 2.0]]", "--set mission.targets=[[1.0, 2.0]]: mission.targets"),
        ("mission.targets_of={drone99: [[1.0, 2.0, 3.0]]}", "no drone 'drone99'; valid: drone1,"),
        ("drones.starts=[[1.0, 2.0, 3.0]]", "drones.starts"),
    ],
)
def test_places_have_three_coordinates_and_belong_to_drones(override, words):
    with pytest.raises(SettingsError, match=re.escape(words)):
        scenarios.load("forest", [override])


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            ["FOO=1"],
            "--set drones.parameters.FOO=1: drones.parameters.FOO: px4 has no such "
            "parameter; valid: BAT1_CAPACITY, ",
        ),
        (["MAV_SYS_ID=1e10"], "MAV_SYS_ID: must be a whole number, -2147483648…2147483647, got"),
        (["COM_OBL_RC_ACT=1.5"], "COM_OBL_RC_ACT: must be a whole number"),
        (["MPC_THR_HOVER=1e39"], "MPC_THR_HOVER: must be a number, -3.4"),
        (["MPC_THR_HOVER=.inf"], "MPC_THR_HOVER: must be a"),
    ],
)
def test_a_parameter_that_the_autopilot_cannot_have_is_refused(overrides, words):
    given = [f"drones.parameters.{o}" for o in overrides]
    with pytest.raises(SettingsError, match=re.escape(words)):
        scenarios.load("forest", given)


def test_a_users_binary_has_parameters_of_its_own():
    own = ["drones.binary=px4", "drones.parameters.SIM_GZ_EN=1"]
    assert scenarios.load("forest", own).drones.parameters == {"SIM_GZ_EN": 1.0}


def test_a_formation_spreads_around_its_last_target():
    s = scenarios.load("tunnel", ["seed=2"])
    start = placement.starts(s)
    goals = np.array(list(placement.targets(s, start).values()))
    assert (goals[:, :-1] == goals[0, :-1]).all()  # shared on the way
    ends = goals[:, -1]
    assert ends.mean(axis=0) == pytest.approx(s.mission.targets[-1], abs=1e-3)
    assert ends[:, :2] - ends[0, :2] == pytest.approx(start[:, :2] - start[0, :2], abs=1e-3)


LEVELS = "mission.levels=[-0.4, 0.3, 1.0]"


def test_drones_are_distributed_over_the_levels_at_random(missions):
    one, two = (placement.levels(load("lsc-forest", seed, missions, LEVELS)) for seed in (0, 1))
    heights, drones = np.unique(one, return_counts=True)
    assert heights.tolist() == [-0.4, 0.3, 1.0]
    assert drones.min() >= 6
    assert (one != two).any()
    assert not placement.levels(load("crossing", 0, missions)).any()
