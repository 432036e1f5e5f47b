"""Figures of made-up truths that are known by construction."""

import json

import numpy as np
import pytest

from sitl_sim.figures.metrics import certificates, ground_strikes, safety, sanity, timing, wilson
from tests.sitl_sim import flights

DT = 0.02


TRUNK = {"x": 4.0, "y": -1.0, "radius": 0.5, "height": 8.0}


def truth(gap, stops, others):
    """a flies 10 m at 1 m/s, standing still for `stops` [s] at 2 m, 3 m, …; b beside it."""
    t = np.arange(0.0, 10.0 + sum(stops) + sum(others) + 4.0, DT)
    p = np.stack(
        [path_with_stops(t, stops), path_with_stops(t, others) + np.array([0.0, gap, 0.0])], axis=1
    )
    return {"t": t, "position": p, "velocity": np.gradient(p, DT, axis=0)}


def path_with_stops(t, stops):
    xs, x, until = [], 0.0, 0.0
    pauses = {2.0 + k: s for k, s in enumerate(stops)}
    for now in t:
        if now >= until:
            x += DT
            for place in [p for p in pauses if p <= x]:
                until = now + pauses.pop(place)
        # On the spot it wavers by a hand's breadth, at 0.6 m/s.
        xs.append(min(x, 10.0) + (0.1 * np.sin(6.0 * now) if now < until else 0.0))
    return np.column_stack([xs, np.zeros_like(t), np.full_like(t, 2.0)])


def figures(gap=1.0, stops=(), others=(), trunk=TRUNK, radius=0.2):
    world = {
        "drone_radius": radius,
        "cylinders": [trunk],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, gap, 2.0]]},
    }
    return safety(truth(gap, stops, others), world, ["a", "b"])


@pytest.mark.parametrize(
    ("gap", "radius", "collides", "below"),
    [(0.6, 0.2, 0, False), (0.49, 0.2, 0, True), (0.39, 0.2, 1, True), (0.39, 0.15, 0, False)],
)
def test_distances_between_drones(gap, radius, collides, below):
    f = figures(gap, radius=radius)
    assert f["mission_complete"]
    assert f["min_agent_distance_m"] == pytest.approx(gap)
    assert (f["agent_collisions"], f["below_agent_safety"]) == (collides, below)


def test_drones_of_two_sizes_touch_at_the_sum_of_their_radii():
    world = {
        "drone_radius": 0.3,
        "drone_radii": {"a": 0.1, "b": 0.3},
        "cylinders": [TRUNK | {"y": -0.85}],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 0.5, 2.0]]},
    }
    apart = safety(truth(0.45, (), ()), world, ["a", "b"])
    assert (apart["agent_collisions"], apart["below_agent_safety"]) == (0, True)
    assert apart["obstacle_collisions"] == 0  # a, which is the small one, passes the trunk
    assert safety(truth(0.35, (), ()), world, ["a", "b"])["agent_collisions"] == 1


def test_targets_count_by_the_estimate_where_the_state_drifts():
    world = {
        "drone_radius": 0.2,
        "cylinders": [],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 1.0, 2.0]]},
        "targets_by": "estimate",
    }
    flown = truth(1.0, (), ())
    off = flown["position"] + np.array([0.0, 0.9, 0.0])
    drifted = safety(flown | {"estimate": off}, world, ["a", "b"])
    assert not drifted["mission_complete"]
    assert drifted["largest_estimate_error_m"] == pytest.approx(0.9)
    moved = {n: [[x, y + 0.9, z] for x, y, z in g] for n, g in world["targets"].items()}
    believed = safety(flown | {"estimate": off}, world | {"targets": moved}, ["a", "b"])
    assert believed["mission_complete"]
    assert safety(flown, world | {"targets_by": "truth"}, ["a", "b"])["mission_complete"]


def among_foreign(names):
    """Return truth and world: a and b fly 0.3 m apart, and b flies through the trunk's edge."""
    wanted = {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 0.3, 2.0]]}
    world = {
        "drone_radius": 0.2,
        "cylinders": [TRUNK | {"y": 0.8}],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {n: t for n, t in wanted.items() if n not in names},
        "foreign": names,
    }
    flown = truth(0.3, (), ())
    flown["velocity"][:, 1] *= 3.0
    return flown, world


def test_a_foreign_drone_counts_where_it_meets_ours_and_nowhere_else():
    flown, world = among_foreign(["b"])
    both = safety(
        flown, world | {"foreign": [], "targets": world["targets"] | {"b": []}}, ["a", "b"]
    )
    assert (both["agent_collisions"], both["obstacle_collisions"]) == (1, 1)
    assert not both["mission_complete"]
    assert "foreign" not in both
    found = safety(flown, world, ["a", "b"])
    assert (found["agent_collisions"], found["obstacle_collisions"]) == (1, 0)
    assert found["min_obstacle_distance_at"][1] == "a"
    assert found["mission_complete"]
    assert found["targets_reached"] == {"a": "1/1"}
    assert found["foreign"] == ["b"]
    assert found["mean_speed_m_s"] == pytest.approx(1.0, abs=0.05)  # a's, not b's 3 m/s


def test_foreign_drones_that_meet_never_fly_or_strike_the_ground_do_not_count():
    flown, world = among_foreign(["b", "c"])
    beside = flown["position"][:, :1] + [0.0, 5.0, 0.0]  # c, which is foreign as b is
    third = {k: np.concatenate([v, w], axis=1) for k, v, w in [
        ("position", flown["position"], flown["position"][:, 1:] + [0.0, 0.1, 0.0]),
        ("velocity", flown["velocity"], flown["velocity"][:, 1:]),
    ]}  # fmt: skip
    third["position"][:, 0] = beside[:, 0]  # a, far from both
    world["targets"] = {"a": [[10.0, 5.0, 2.0]]}
    names = ["a", "b", "c"]
    ours_alone = safety(flown | third, world, names)
    assert ours_alone["agent_collisions"] == 0
    assert ours_alone["min_agent_distance_m"] == pytest.approx(4.6)
    assert not ours_alone["below_agent_safety"]
    third["position"][:, 1, 2] = 0.0
    third["position"][300:, 2, 2] = 0.0
    grounded = safety(flown | third, world, names)
    assert (grounded["never_flew"], grounded["ground_strikes"]) == ([], 0)
    of_all = safety(
        flown | third, world | {"foreign": [], "targets": {n: [] for n in names}}, names
    )
    assert (of_all["never_flew"], of_all["ground_strikes"]) == (["b"], 1)


def test_heights_count_from_the_ground():
    """On a plateau 1.9 m high, drones at 2 m have not left the ground."""
    world = {
        "drone_radius": 0.2,
        "cylinders": [],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 1.0, 2.0]]},
    }
    plateau = {"x": [-50.0, 50.0], "y": [-50.0, 50.0], "z": [[1.9, 1.9], [1.9, 1.9]]}
    flown = truth(1.0, (), ())
    assert safety(flown, world, ["a", "b"])["never_flew"] == []
    assert safety(flown, world | {"terrain": plateau}, ["a", "b"])["never_flew"] == ["a", "b"]


@pytest.mark.parametrize(
    ("y", "collides", "below"), [(-1.0, 0, False), (-0.75, 0, True), (-0.65, 1, True)]
)
def test_distances_to_obstacles(y, collides, below):
    f = figures(trunk=TRUNK | {"y": y})
    assert f["min_obstacle_distance_m"] == pytest.approx(-y - 0.5, abs=1e-3)
    assert (f["obstacle_collisions"], f["below_obstacle_safety"]) == (collides, below)


def test_the_longest_standstill_is_that_on_the_way():
    moving = figures()
    assert moving["longest_standstill_s"] == pytest.approx(0.5, abs=0.15)  # though both hover then
    held_up = figures(stops=(2.0, 3.0))
    assert held_up["longest_standstill_s"] == pytest.approx(3.0 + 0.5, abs=0.2)
    assert held_up["longest_deadlock_s"] == pytest.approx(0.5, abs=0.15)  # b flies on
    both = figures(stops=(2.0, 3.0), others=(3.0, 1.0))
    assert both["longest_deadlock_s"] == pytest.approx(2.0 + 0.5, abs=0.2)


def test_a_drone_that_never_sets_out_is_no_deadlock_of_the_others():
    flight = truth(1.0, (), ())
    flight["position"][:, 1, 0] = 0.0
    world = {
        "drone_radius": 0.2,
        "cylinders": [],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 1.0, 2.0]]},
    }
    assert not safety(flight, world, ["a", "b"])["mission_complete"]
    assert safety(flight, world, ["a", "b"])["longest_deadlock_s"] < 1.0


@pytest.mark.parametrize(
    ("low", "forward", "strikes"),
    [(0.0, 1.0, 1), (0.0, 0.4, 1), (0.0, 0.3, 0), (0.5, 1.0, 0)],
)
def test_a_drone_that_touches_the_ground_on_its_way_has_struck_it(low, forward, strikes):
    """A take-off at 2 m/s, a dip to `low` [m] at `forward` × 3 m/s, a landing at 1 m/s."""
    t = np.arange(0.0, 20.0, DT)
    z = np.interp(t, [0.0, 1.0, 5.0, 8.0, 9.0, 12.0, 16.0, 18.0], [0, 2, 2, low, low, 2, 2, 0])
    x = np.clip(t - 2.0, 0.0, 10.0) * 3.0 * forward
    p = np.column_stack([x, np.zeros_like(t), z])[:, None]
    v = np.gradient(p, DT, axis=0)
    world = {
        "drone_radius": 0.2,
        "cylinders": [],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[*x[-1:].tolist(), 0.0, 2.0]]},
    }
    flown = safety({"t": t, "position": p, "velocity": v}, world, ["a"])
    assert flown["ground_strikes"] == strikes


@pytest.mark.parametrize(("took", "counted", "misses"), [(153.0, 0, 4), (99.0, 3, 3), (99.0, 0, 0)])
def test_a_tick_longer_than_its_period_is_a_miss_in_lockstep_too(took, counted, misses):
    tick = {"stages_ms": {"tick": took}, "counters": {"deadline_misses": counted}}
    figures = timing({"a": [tick] * 4, "b": []})
    assert figures["deadline_misses"] == misses
    assert figures["deadline_miss_rate"] == misses / 4


def test_drones_that_never_fly_together_have_no_distance():
    flight = truth(1.0, (), ())
    flight["position"][:, 1, 2] = 0.0
    world = {
        "drone_radius": 0.2,
        "cylinders": [],
        "boxes": [],
        "target_tolerance": 0.5,
        "targets": {"a": [[10.0, 0.0, 2.0]], "b": [[10.0, 1.0, 2.0]]},
    }
    flown = safety(flight, world, ["a", "b"])
    assert (flown["min_agent_distance_m"], flown["min_agent_distance_at"]) == (None, None)
    assert (flown["agent_collisions"], flown["below_agent_safety"]) == (0, False)
    json.dumps(flown, allow_nan=False)


@pytest.mark.parametrize(
    ("good", "runs", "low", "high"),
    [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (50, 100, 0.4038, 0.5962), (1, 1, 0.2065, 1.0)],
)
def test_wilsons_interval(good, runs, low, high):
    assert wilson(good, runs) == pytest.approx((low, high), abs=2e-4)


def test_an_impossible_truth_is_noticed():
    assert sanity(flights.truth()) == []
    for spoil, words in [
        (lambda w: w["position"].__setitem__((300, 0), [9.0, 9.0, 9.0]), "disagree"),
        (lambda w: w["attitude"].__setitem__((5, 0), [1.0, 1.0, 0.0, 0.0]), "unit quaternion"),
        (lambda w: w["velocity"].__setitem__((5, 0, 0), np.nan), "not finite"),
        (lambda w: w["t"].__setitem__(5, 0.0), "time does not rise"),
    ]:
        world = flights.truth()
        spoil(world)
        assert any(words in fault for fault in sanity(world))


def test_ticks_that_were_not_judged_count_with_their_broken_bounds_alone():
    judged = {"beyond": [], "flown": "command", "margin": 0.4, "cause": "obstacle"}
    refused = {"beyond": ["neighbour 3"], "flown": "none", "margin": -0.1, "cause": "neighbour"}
    ticks = [judged, {"beyond": ["neighbour 3"]}, {}, refused, judged]
    found = certificates({"a": [{"phase": "fly", "certificate": c} for c in ticks]})
    assert found["certified_share"] == pytest.approx(2 / 3)
    assert found["plans_refused"] == {"neighbour": 1}
    assert found["bounds_broken_ticks"] == 2


def test_a_drone_that_gusts_push_along_as_it_takes_off_has_struck_nothing():
    above = np.array([0.0, 0.05, 0.1, 0.25, 0.5, 0.1])[:, None]
    v = np.zeros((6, 1, 3))
    v[1:4, 0, 0] = 1.4
    assert not ground_strikes(above, v, np.array([0.2])).any()
    v[5, 0, 0] = 1.1
    assert ground_strikes(above, v, np.array([0.2])).all()
