"""The folder of a campaign: one kind of flights, one campaign at a time."""

import json
from pathlib import Path

import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns.campaign import Campaign
from sitl_sim.campaigns.campaign_folder import campaign_folder

SCENARIO = """
fileversion: 1
name: hop
drones: {count: 2, jitter: 0.3, heading_deg: 0.0}
mission: {targets: [[30.0, 0.0, 2.0]], home: false, time_limit: 5.0}
sensing: {neighbours: truth, obstacles: map}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "hop.yaml"
    file.write_text(SCENARIO)
    return str(file)


def campaign(scenario, out, *options):
    return main(
        ["campaign", scenario, "--out", str(out), "--workers", "2", "--in-process", *options]
    )


def settings(scenario, *overrides):
    return Campaign(scenario, list(overrides), 1, 0, Path("anywhere")).settings()


def test_a_folder_of_other_flights_is_refused_and_unchanged(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    with campaign_folder(out, settings(scenario)):
        (out / "unfinished" / "hop-0-17").mkdir(parents=True)
    Path(scenario).write_text(SCENARIO.replace("time_limit: 5.0", "time_limit: 6.0"))
    assert campaign(scenario, out, "--set", "drones.count=1") == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert (
        "holds another campaign (drones.count 2, not 1, mission.time_limit 5.0, not 6.0)"
        in (lines[0])
    )
    assert (out / "unfinished" / "hop-0-17").exists()


def test_a_folder_of_another_version_is_refused_in_a_line(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "campaign.json").write_text(json.dumps({"name": "hop", "overrides": []}))
    assert campaign(scenario, out) == 2
    assert len(capsys.readouterr().err) < 600


def test_earlier_files_stay(scenario, tmp_path):
    theirs = tmp_path / "out" / "unfinished" / "thesis.txt"
    theirs.parent.mkdir(parents=True)
    theirs.touch()
    with campaign_folder(tmp_path / "out", settings(scenario)):
        assert theirs.exists()


def test_two_campaigns_do_not_fly_into_one_folder(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    with campaign_folder(out, settings(scenario)):
        assert campaign(scenario, out) == 2
    assert "another campaign is flying into it" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["", "[1]", "no json"])
def test_damaged_settings_are_one_clear_line(scenario, tmp_path, capsys, content):
    out = tmp_path / "out"
    out.mkdir()
    (out / "campaign.json").write_text(content)
    assert campaign(scenario, out) == 2
    assert "campaign.json: not what a campaign wrote" in capsys.readouterr().err
