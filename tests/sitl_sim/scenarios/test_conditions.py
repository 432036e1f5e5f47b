"""Keys of state, timing, wind, ground and airframes: what they give, and what they refuse."""

import numpy as np
import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.flight.autopilots import true_airframes
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import companion_config
from sitl_sim.scenarios.conditions import WindConfig, drawn
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.ground import Ground

PLAIN = ("world.look=plain", "drones.look=ball")


def load(*overrides, name="forest"):
    return scenarios.load(name, list(overrides))


WRONG = [
    ("drones.state=gnss", "drones.state: must be 'mocap', 'rtk', 'gps' or 'vio'"),
    ("timing.compute_delay=0.3", "timing.compute_delay: takes 0.002…0.2 s, or [least, most] in it"),
    ("timing.telemetry_lag=[0.2, 0.1]", "timing.telemetry_lag: takes 0…0.2 s"),
    ("timing.telemetry_stamp=now", "timing.telemetry_stamp: must be 'sent' or 'measured'"),
    ("wind.turbulence=strong", "wind.turbulence: must be 'none', 'light', 'moderate' or 'severe'"),
    ("wind=[3, 0]", "wind: List should have at least 3 items"),
    ("wind.gusts=3", "wind.gusts: unknown key; valid: mean, turbulence"),
    ("world.ground=hilly", "world.ground: must be 'flat', 'slope', 'uneven' or 'steps'"),
    ("drones.airframes=[quad9]", "drones.airframes: must hold `key: value` lines; valid: arm, "),
    ("drones.actual={weight: 1.2}", "drones.actual.weight: unknown key; valid: battery, drag, "),
    ("drones.actual={mass: 0}", "drones.actual: Input should be greater than 0"),
]


@pytest.mark.parametrize(("override", "what"), WRONG)
def test_a_wrong_key_is_named_with_its_choices(override, what):
    with pytest.raises(SettingsError) as caught:
        load(override)
    assert what in caught.value.problems[0]


@pytest.mark.parametrize(
    "override",
    ["drones.state=gps", "wind.turbulence=light", "air.downwash=true", "world.ground=uneven",
     "timing.telemetry_lag=0.1", "drones.airframes=[quad7]", "drones.actual={mass: 1.2}"],
)  # fmt: skip
def test_what_real_autopilots_cannot_have_is_refused(override):
    with pytest.raises(SettingsError) as caught:
        load("drones.autopilot=betaflight", override)
    key = override.partition("=")[0]
    assert f"{key}: needs emulated autopilots" in caught.value.problems[0]


def test_a_list_of_three_numbers_is_a_steady_wind():
    assert load("wind=[3, 0, 0.5]").wind == WindConfig(mean=[3.0, 0.0, 0.5])
    assert load().wind.mean == [0.0, 0.0, 0.0]


def test_packaged_scenarios_fly_what_only_emulated_autopilots_can_have():
    emulated = load()
    assert (emulated.drones.state, emulated.wind.turbulence) == ("vio", "light")
    for real in ("drones.autopilot=betaflight", "drones.binary=/usr/bin/true"):
        flown = load(real)
        assert (flown.drones.state, flown.wind.turbulence) == ("mocap", "none")
    chosen = load("drones.state=gps", "wind.mean=[2, 0, 0]")
    assert (chosen.drones.state, chosen.wind.turbulence) == ("gps", "light")


def test_what_lies_beneath_counts_in_a_scenario_that_says_nothing_of_its_drones(tmp_path):
    (tmp_path / "s.yaml").write_text("name: s\nemulated: {drones: {state: rtk}}\n")
    assert scenarios.load(str(tmp_path / "s.yaml"), []).drones.state == "rtk"


def test_a_mistake_beneath_is_named_with_its_place(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "fileversion: 1\nname: s\ndrones: {count: 1}\nemulated:\n  drones: {state: gnss}\n"
    )
    with pytest.raises(SettingsError, match=r"s\.yaml:5:12: drones\.state: must be 'mocap'"):
        scenarios.load(str(tmp_path / "s.yaml"), [])


def test_a_range_is_drawn_for_each_drone_by_the_seed_alone():
    delays = drawn([0.02, 0.12], 9, 5, 1)
    assert 0.02 <= delays.min() < delays.max() <= 0.12
    np.testing.assert_array_equal(delays, drawn([0.02, 0.12], 9, 5, 1))
    assert not np.allclose(delays, drawn([0.02, 0.12], 9, 6, 1))
    np.testing.assert_array_equal(drawn(0.05, 3, 5, 1), 0.05)


def test_no_companion_is_told_of_delays_or_of_what_its_vehicle_truly_is(tmp_path):
    plain = companion_config(load(), 0, tmp_path, clock=False)
    odd = load(
        "timing.compute_delay=[0.02, 0.2]", "timing.telemetry_lag=0.2", "drones.state=vio",
        "drones.actual={mass: 1.2, thrust: 0.75, rate_gains: 0.5}", "wind.turbulence=severe",
    )  # fmt: skip
    assert companion_config(odd, 0, tmp_path, clock=False) == plain


def test_mixed_airframes_are_told_and_taken_in_turn(tmp_path):
    s = load("drones.airframes=[quad3, {name: quad5, mass: 0.9}]", "drones.actual={mass: [1, 1.2]}")
    told = [companion_config(s, i, tmp_path, clock=False)["airframe"] for i in range(3)]
    assert [a["radius"] for a in told] == [0.13, 0.2, 0.13]
    assert told[1]["hover_thrust"] == pytest.approx(0.9 * 9.80665 / (4 * 5.15), abs=1e-3)
    masses = [a.mass for a in true_airframes(s)]
    assert 0.3 <= masses[0] <= 0.36
    assert 0.9 <= masses[1] <= 1.08
    assert masses[0] != masses[2]


def test_every_neighbour_counts_as_large_as_the_largest_of_the_fleet(tmp_path):
    for fleet, largest in (("[quad3, quad7]", 0.28), ("[quad3]", 0.13), ("[]", 0.2)):
        s = load("drones.count=3", f"drones.airframes={fleet}")
        for i in range(3):
            told = companion_config(s, i, tmp_path, clock=False)["certificate"]
            assert told == {"neighbour_radius": largest}


def test_pictures_of_the_plain_look_never_show_flat_ground_where_there_are_hills():
    with pytest.raises(SettingsError) as caught:
        load(*PLAIN, "world.ground=uneven")
    assert "world.look: plain shows no hills" in caught.value.problems[0]
    with pytest.raises(SettingsError, match="plain shows no hills; steps"):
        load(*PLAIN, "world.ground=steps")
    with pytest.raises(SettingsError, match="steps: walls stand on level ground"):
        load("world.ground=steps", name="tunnel")
    assert load("world.ground=uneven", "world.look=clearing").world.look == "clearing"


def test_a_slope_is_one_plane_of_its_angle_and_has_no_walls():
    s = load("world.ground=slope", "world.slope_deg=8", "seed=4")  # in the plain look
    ground = Ground(build(s.world, s.seed))
    x, y = np.meshgrid([-20.0, 3.0, 31.0], [-14.0, 0.0, 25.0])
    height, east, north = ground.plane(x, y)
    np.testing.assert_allclose(height, east[0, 0] * x + north[0, 0] * y, atol=1e-3)
    assert np.degrees(np.arctan(np.hypot(east, north))) == pytest.approx(8.0, abs=1e-3)
    with pytest.raises(SettingsError, match="walls stand on level ground"):
        load("world.ground=slope", "world.boxes=[{min: [0, 0, 0], max: [1, 1, 1]}]")


@pytest.mark.parametrize(
    "options",
    [
        ("world.ground=uneven", "world.look=clearing"),
        ("world.ground=slope",),
        ("world.ground=steps", "drones.spacing=5"),
    ],
)
def test_starts_targets_and_trunks_stand_on_ground_that_is_not_flat(options):
    s = load(*options, "seed=3")
    world, start = build(s.world, s.seed), placement.starts(s)
    ground = Ground(world)
    np.testing.assert_allclose(start[:, 2], ground.height(start[:, 0], start[:, 1]))
    assert np.ptp(start[:, 2]) > 0.02
    goals = np.array([g for goals in placement.targets(s, start).values() for g in goals])
    np.testing.assert_allclose(
        goals[:, 2] - ground.height(goals[:, 0], goals[:, 1]), 2.0, atol=1e-3
    )
    trunk = world["cylinders"][0]
    assert trunk["height"] == pytest.approx(8.0 + ground.height(trunk["x"], trunk["y"]), abs=1e-3)
    flat = load("seed=3")
    assert [c["x"] for c in build(flat.world, 3)["cylinders"]] == [
        c["x"] for c in world["cylinders"]
    ]


def test_the_ground_is_level_where_walls_stand():
    s = load("world.ground=uneven", "world.look=clearing", name="tunnel")
    ground = Ground(build(s.world, s.seed))
    np.testing.assert_allclose(ground.height([-10.0, 0.0, 10.0], 0.0), 0.0, atol=1e-9)
    assert abs(ground.height(0.0, 20.0)) > 0.05


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        ("forest", (), ("camera", "network", "network")),
        ("tunnel", (), ("camera", "depth", "network")),
        ("forest", ("sensing.neighbours=truth",), ("truth", "network", None)),
        ("forest", ("sensing.obstacles=map",), ("camera", "map", "network")),
        ("forest", ("sensing.eyes=color",), ("camera", "camera", None)),
        ("forest", ("companion.sensing.detector=cnn",), ("camera", "network", "cnn")),
        ("forest", ("drones.autopilot=betaflight",), ("camera", "camera", None)),
        ("commission", (), ("camera", "camera", None)),
    ],
)
def test_by_what_companions_find_neighbours_and_obstacles(name, changes, told, tmp_path):
    given = companion_config(load(*changes, name=name), 0, tmp_path, clock=False)["sensing"]
    assert (given["neighbours"], given["obstacles"], given.get("detector")) == told
