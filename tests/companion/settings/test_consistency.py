"""Contradictions between sections, each with the place of one of its keys."""

import pytest

from companion.settings.config import load_config

HEAD = "fileversion: 2\nname: one\n"

# Text below HEAD, line:column, what the message holds.
CONTRADICTIONS = [
    ("mission:\n  takeoff_altitude: 9.0\n", "4:3", "takeoff_altitude must lie inside the fence"),
    ("mission:\n  goals: [[1, 2, 3], [1, 2, 9]]\n", "4:22", "the goal, 9 m high, must lie inside"),
    (
        "mission:\n  level: 2.5\n  goals: [[1, 2, 3]]\n",
        "5:11",
        "mission.goals.0: the way to it, 5.5 m high, must lie inside the fence",
    ),
    (
        "fence:\n  altitude_min: 6.0\n",
        "4:3",
        "fence.altitude_min: altitude_max must be above altitude_min",
    ),
    (
        "fence: {east: [-5, 5]}\nmission:\n  goals: [[1, 2, 3], [50, 2, 3]]\n",
        "5:22",
        "mission.goals.1: must lie inside fence.east, [-5.0, 5.0], got [50.0, 2.0, 3.0]",
    ),
    (
        "fence: {north: [3, 5]}\nmission: {goals: [[1, 2, 3]]}\n",
        "4:19",
        "mission.goals.0: must lie inside fence.north, [3.0, 5.0], got [1.0, 2.0, 3.0]",
    ),
    (
        "airframe: {radius: 0.8}\n",
        "3:12",
        "airframe.radius: nmpc.d_obstacle_safety, 0.6, from the drone's centre, must be above",
    ),
    ("nmpc: {d_obstacle_safety: 0.2}\n", "3:8", "must be above airframe.radius, 0.2"),
    (
        "airframe: {radius: 0.4}\n",
        "3:12",
        "airframe.radius: nmpc.d_agent_safety, 0.8, from centre to centre, must be above twice",
    ),
    (
        "timing: {period: 0.05}\n",
        "3:10",
        "timing.period: nmpc.dt, 0.1, must be timing.period, 0.05",
    ),
    ("nmpc:\n  dt: 0.2\n", "4:3", "nmpc.dt: nmpc.dt, 0.2, must be timing.period, 0.1"),
    (
        "timing: {period: 0.2}\nnmpc: {dt: 0.2}\n",
        "3:10",
        "timing.period: guard.late, 0.15, must be above timing.period, 0.2",
    ),
    (
        "guard: {c_min: 3.0}\n",
        "3:9",
        "guard.c_min: guard.c_min, 3, must be at most nmpc.c_min, 2, or the guard clips plans",
    ),
    (
        "nmpc: {c_max: 25.0}\n",
        "3:8",
        "nmpc.c_max: guard.c_max, 20, must be at least nmpc.c_max, 25",
    ),
    (
        "nmpc: {omega_max: 4.0}\nguard: {omega_max: 3.5}\n",
        "4:9",
        "guard.omega_max: guard.omega_max, 3.5, must be at least nmpc.omega_max, 4",
    ),
    (
        "camera: {latency: 0.3}\n",
        "3:10",
        "every frame is late: camera.latency, 0.3, must be below camera_health.late, 0.18",
    ),
    (
        "sensing: {trunks_every: 8}\n",
        "3:11",
        "sensing.trunks_every: trunks would be forgotten between two searches",
    ),
    (
        "fence: {altitude_band: 0.1}\n",
        "3:9",
        "fence.altitude_band: altitude_band, 0.1, must be at least nmpc.d_obstacle_safety, 0.6",
    ),
    (
        "fence: {altitude_max: 1.9}\nmission: {takeoff_altitude: 1.5}\n",
        "3:9",
        "fence.altitude_max: altitude_max must be above altitude_min by twice nmpc.d_obst",
    ),
    ("fence: {east: [0, 1.1]}\n", "3:9", "fence.east: must be wider than twice nmpc.d_obstacle"),
    (
        "fence: {east: [-5, 5]}\nmission:\n  goals: [[1, 2, 3], [5, 2, 3]]\n",
        "5:22",
        "mission.goals.1: must lie 0.35 m inside the fence, [-5.0, 5.0], or it is never reached",
    ),
    ("mission: {goals: [[1, 2, 1.1]]}\n", "3:19", "must lie 0.35 m inside the fence, [0.8, 5.0]"),
    (
        "camera: {source: 'device:0'}\nsensing: {neighbours: truth}\n",
        "4:11",
        "sensing.neighbours: neighbours: truth needs the simulator as source; a camera has",
    ),
    (
        "camera: {source: 'device:0'}\nsensing: {obstacles: depth}\n",
        "4:11",
        "sensing.obstacles: obstacles: depth needs the simulator as source; a camera has",
    ),
]


@pytest.mark.parametrize(("text", "place", "what"), CONTRADICTIONS)
def test_each_contradiction_names_both_keys_and_a_place(check, text, place, what):
    check(text, place, what)


def test_the_guard_may_be_wider_than_the_plan(folder):
    file = folder / "one.yaml"
    file.write_text(HEAD + "guard: {c_min: 1.0, c_max: 25.0, omega_max: 4.0}\n")
    assert load_config(file).guard.omega_max == 4.0
