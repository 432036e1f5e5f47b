"""The swarm as a PettingZoo environment: PettingZoo's own tests of API and seeds, and its meaning.

PettingZoo is no part of the development environment: pip install 'swarm-companion[gym]'.
"""

import numpy as np
import pytest

from sitl_sim.gym_actor import SIZE, Meeting

SCENARIO = """
fileversion: 1
name: pair
seed: 3
world: {cylinders: [{x: 30.0, y: 0.4, radius: 0.5}]}
drones: {count: 2, spacing: 1.5, heading_deg: 0.0, frame_yaw_deg: random}
mission: {targets: [[8.0, 0.0, 2.0]], home: false, time_limit: 25.0}
"""


@pytest.fixture
def make(tmp_path):
    pytest.importorskip("pettingzoo")
    from sitl_sim.gym import SwarmEnv

    (tmp_path / "pair.yaml").write_text(SCENARIO)
    made = []

    def make(**options):
        made.append(SwarmEnv(tmp_path / "pair.yaml", **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def env(make):
    return make()


SMALL = {"sensing.width": 96, "sensing.height": 64, "sensing.depth.width": 64}


def test_pettingzoo_finds_no_fault_in_the_api(env):
    from pettingzoo.test import parallel_api_test

    parallel_api_test(env, num_cycles=60)


def test_the_same_seed_and_actions_give_the_same_flight(env):
    flights = []
    for seed in (5, 5, 6):
        seen, _ = env.reset(seed=seed)
        rows = [seen["drone1"]]
        for k in range(15):
            seen, *_ = env.step({a: np.array([1.0, 0.1 * k], np.float32) for a in env.agents})
            rows.append(seen["drone1"])
        flights.append(np.array(rows))
    np.testing.assert_array_equal(flights[0], flights[1])
    assert np.abs(flights[0] - flights[2]).max() > 1e-3


def test_the_drone_flies_where_the_action_says_and_is_paid_for_its_way(env):
    seen, _ = env.reset(seed=1)
    assert seen["drone1"].shape == (SIZE,)
    goal = np.array([8.0, 0.0])
    started = np.linalg.norm(goal - env._flight.vehicles.p[0, :2])
    total, fastest = 0.0, 0.0
    for _ in range(80):
        actions = {a: seen[a][2:4] for a in env.agents}  # towards the goal
        seen, rewards, ended, *_ = env.step(actions)
        total += rewards["drone1"]
        v, way = seen["drone1"][:2], seen["drone1"][2:4]
        fastest = max(fastest, float(v @ way) / max(float(np.linalg.norm(way)), 0.1))
        assert not any(ended.values())
    assert fastest > 0.7
    left = np.linalg.norm(goal - env._flight.vehicles.p[0, :2])
    assert total == pytest.approx(started - left, abs=0.1)
    assert 2.0 < total < started


def test_without_an_action_it_stays(env):
    env.reset(seed=1)
    start = env._flight.vehicles.p.copy()
    for _ in range(50):
        env.step({a: np.zeros(2, np.float32) for a in env.agents})
    away = np.linalg.norm((env._flight.vehicles.p - start)[:, :2], axis=1)
    assert (away < 0.5).all()


@pytest.mark.timeout(900)  # kernels of the renderer are compiled at their first use
@pytest.mark.parametrize("action", ["velocity", "rates"])
@pytest.mark.parametrize("kind", ["picture", "depth"])
def test_pettingzoo_finds_no_fault_in_pictures_and_rates(make, kind, action):
    from pettingzoo.test import parallel_api_test

    parallel_api_test(make(observation=kind, action=action, changes=SMALL), num_cycles=5)


@pytest.mark.timeout(900)
def test_a_picture_shows_the_tick_that_the_numbers_are_of(make):
    env = make(observation="picture", changes=SMALL)
    seen, _ = env.reset(seed=4)
    flights = []
    for _ in range(2):
        pictures = [seen["drone1"]["picture"]]
        for _ in range(4):
            seen, *_ = env.step({a: np.array([1.0, 0.3], np.float32) for a in env.agents})
            pictures.append(seen["drone1"]["picture"])
        flights.append(np.array(pictures))
        seen, _ = env.reset(seed=4)
    assert flights[0].shape == (5, 64, 96, 3)
    assert flights[0].std() > 10  # something is in it
    assert (flights[0][0] != flights[0][-1]).mean() > 0.1  # and it changes
    np.testing.assert_array_equal(*flights)
    env = make(observation="depth", changes=SMALL)
    seen, _ = env.reset(seed=4)
    depth = seen["drone1"]["depth"]
    assert depth.shape == (43, 64)
    assert 0.5 < depth.min() < 15.0


def test_thrust_and_rates_fly_the_drone(make):
    """A policy of a few lines keeps height and attitude, and falls where it takes thrust away."""
    env = make(action="rates")
    seen, _ = env.reset(seed=1)
    start = env._flight.vehicles.p.copy()

    def fly(extra, ticks):
        nonlocal seen
        for _ in range(ticks):
            actions = {}
            for a in env.agents:
                up, climb, w, x, y, _ = seen[a][-6:]
                tilt = 2.0 * np.array([x, y]) * np.sign(w)  # small angles, body axes
                lift = 9.81 + 2.0 * up - 2.0 * climb + extra
                actions[a] = np.array([lift, *(-4.0 * tilt), 0.0], np.float32)
            seen, *_ = env.step(actions)

    fly(0.0, 30)
    assert np.abs((env._flight.vehicles.p - start)[:, 2]).max() < 0.4
    height = env._flight.vehicles.p[:, 2].copy()
    fly(-1.5, 15)
    assert (env._flight.vehicles.p[:, 2] < height - 0.3).all()


def test_a_wrong_kind_lists_the_valid_ones(make):
    from mavlink_bridge.shared.settings import SettingsError

    with pytest.raises(ValueError, match="valid: instance, picture, depth; velocity, rates"):
        make(observation="smell")
    with pytest.raises(SettingsError, match="no depth is rendered: neighbours truth"):
        make(observation="depth", changes={"sensing.obstacles": "map"})


def test_a_step_asks_every_actor_once():
    import threading

    meeting, said = Meeting(["a", "b"]), []

    def flight():
        meeting.begin()
        for k in range(3):
            for name in ("a", "b"):
                said.append((k, name, float(meeting.action(name, np.zeros(1), (0.0,))[0])))
        meeting.ended()

    thread = threading.Thread(target=flight)
    thread.start()
    for speed in (1.0, 2.0, 3.0):
        meeting.step({n: np.full(2, speed) for n in "ab"})
    thread.join(10.0)
    assert meeting.over
    assert said == [(k, n, k + 1.0) for k in range(3) for n in "ab"]


def test_a_foreign_drone_is_no_agent_and_a_contact_with_it_ends_an_episode(make):
    env = make(changes={"drones.foreign": {"drone1": {"does": "hover"}}})
    assert env.possible_agents == ["drone2"]
    seen, _ = env.reset(seed=3)
    assert set(seen) == {"drone2"}
    still = {"drone2": np.zeros(2, np.float32)}
    _, _, ended, _, _ = env.step(still)
    assert ended == {"drone2": False}
    p = env._flight.vehicles.p
    p[0] = p[1] + [0.2, 0.0, 0.0]
    _, rewards, ended, _, _ = env.step(still)
    assert ended == {"drone2": True}
    assert rewards["drone2"] < -9.0
    assert env.agents == []
