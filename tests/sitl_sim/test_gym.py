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
def env(tmp_path):
    pytest.importorskip("pettingzoo")
    from sitl_sim.gym import SwarmEnv

    (tmp_path / "pair.yaml").write_text(SCENARIO)
    made = SwarmEnv(tmp_path / "pair.yaml")
    yield made
    made.close()


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
    total, fastest = 0.0, 0.0
    for _ in range(70):
        actions = {a: seen[a][2:4] for a in env.agents}  # towards the goal
        seen, rewards, ended, *_ = env.step(actions)
        total += rewards["drone1"]
        v, way = seen["drone1"][:2], seen["drone1"][2:4]
        fastest = max(fastest, float(v @ way) / max(float(np.linalg.norm(way)), 0.1))
        assert not any(ended.values())
    assert fastest > 0.7
    assert 2.0 < total < 9.0  # of the 8 m to the goal


def test_without_an_action_it_stays(env):
    env.reset(seed=1)
    start = env._flight.vehicles.p.copy()
    for _ in range(50):
        env.step({a: np.zeros(2, np.float32) for a in env.agents})
    away = np.linalg.norm((env._flight.vehicles.p - start)[:, :2], axis=1)
    assert (away < 0.5).all()


def test_a_step_asks_every_actor_once():
    import threading

    meeting, said = Meeting(["a", "b"]), []

    def flight():
        meeting.begin()
        for k in range(3):
            for name in ("a", "b"):
                said.append((k, name, float(meeting.velocity(name, np.zeros(1))[0])))
        meeting.ended()

    thread = threading.Thread(target=flight)
    thread.start()
    for speed in (1.0, 2.0, 3.0):
        meeting.step({n: np.full(2, speed) for n in "ab"})
    thread.join(10.0)
    assert meeting.over
    assert said == [(k, n, k + 1.0) for k in range(3) for n in "ab"]
