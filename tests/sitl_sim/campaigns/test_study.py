"""Studies: campaigns compared on one page; flights that exist are not flown again."""

import json

import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns import study as studies

STUDY = """
title: Fast or slow
scenarios: [circle]
set: [sensing.neighbours=truth]
cases:
  fast: []
  slow: [companion.nmpc.speed=0.5]
"""


@pytest.fixture
def study(tmp_path):
    """A study whose flights have been flown: all of `fast` succeeded, half of `slow`."""
    file = tmp_path / "speeds.yaml"
    file.write_text(STUDY)
    for case in ("fast", "slow"):
        for seed in range(4):
            ok = case == "fast" or seed % 2 == 0
            run = tmp_path / "runs" / "circle" / case / f"circle-{seed}"
            run.mkdir(parents=True)
            (run / "metrics.json").write_text(json.dumps(metrics(seed, ok)))
    return file


def metrics(seed, ok):
    return {
        "ok": ok,
        "seed": seed,
        "commit": f"c{seed // 2}",
        "scenario": "circle",
        "drones": 10,
        "mission_complete": ok,
        "targets_reached": {"drone1": "1/1", "drone2": f"{int(ok)}/1"},
        "never_flew": [],
        "faults_in_truth": [],
        "agent_collisions": int(not ok),
        "obstacle_collisions": 0,
        "min_agent_distance_m": 0.7 + 0.1 * seed if ok else 0.3,
        "min_obstacle_distance_m": None,
        "below_agent_safety": not ok,
        "below_obstacle_safety": False,
        "longest_standstill_s": 1.0,
        "longest_deadlock_s": 0.5,
        "mission_time_s": 20.0 + seed if ok else None,
        "duration_s": 30.0,
        "mean_speed_m_s": 1.4,
        "order": 0.5,
        "union": 1.0,
        "connectivity": 0.3,
        "solve_ms": {"p50": 2.0, "p99": 4.0, "max": 5.0},
    }


def test_every_packaged_study_names_valid_scenarios_and_settings(tmp_path):
    for name in studies.names():
        # Making the campaigns reads each scenario with each case's settings.
        cells = list(studies.cells(studies.load(name), tmp_path, 1, 0, True))
        assert len(cells) == len({c.campaign.folder for c in cells}) >= 2


def test_a_study_becomes_a_page_with_table_plot_and_failures(study, tmp_path, capsys):
    page = tmp_path / "page"
    asked = [
        "study",
        str(study),
        "--runs",
        "4",
        "--seed",
        "0",
        "--out",
        str(tmp_path / "runs"),
        "--page",
        str(page),
    ]
    assert main(asked) == 0
    assert capsys.readouterr().out.strip() == str(page / "speeds.md")
    text = (page / "speeds.md").read_text()
    assert "# Fast or slow" in text
    assert "speeds.yaml --runs 4 --seed 0`, seeds 0 to 3, commit c0, c1." in text
    assert "| circle | fast | 4 of 4 | 51% – 100% | 0 | 0.70 / 0.85 | – / – | 21.5 | 1.40 |" in text
    assert "| circle | slow | 2 of 4 | 15% – 85% | 2 | 0.30 / 0.50 |" in text
    assert "- circle, slow, seed 1: targets missed by drone2; 1 pair(s) of drones collided" in text
    plot = (page / "speeds.svg").read_bytes()
    for word in ("fast", "success", "between drones [m]", "to a surface [m]", "all targets [s]"):
        assert word.encode() in plot
    assert json.loads((page / "speeds.json").read_text())[1]["ok"] == 2
    main(asked)
    assert (page / "speeds.svg").read_bytes() == plot  # the same figures, the same file


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["leaderbord"], "no study 'leaderbord'; valid: ablation, certificate, estimation"),
        (["leaderboard", "--scenarios", "forest,wood"], "no 'wood' in this study; valid: forest"),
        (["gaze", "--cases", "shut"], "no 'shut' in this study; valid: sweep off"),
    ],
)
def test_a_wrong_name_is_refused_with_the_valid_ones(arguments, words, capsys):
    assert main(["study", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_a_mistake_in_the_last_case_shows_before_the_first_case_flies(study, tmp_path, capsys):
    study.write_text(STUDY + "  wrong: [drones.cuont=3]\n")
    runs = tmp_path / "nothing"
    assert main(["study", str(study), "--runs", "1", "--out", str(runs)]) == 2
    assert "drones.cuont: unknown key" in capsys.readouterr().err
    assert not runs.exists()
