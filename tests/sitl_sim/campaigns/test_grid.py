"""A study's grid: every combination is a case, with a name that can be read."""

import json

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.__main__ import main
from sitl_sim.campaigns import study as studies


def read(tmp_path, text):
    file = tmp_path / "mine.yaml"
    file.write_text(f"title: Mine\nscenarios: [forest]\n{text}")
    return studies.load(str(file))


def test_every_combination_of_the_grid_is_a_case(tmp_path):
    grid = "{companion.nmpc.speed: [1.0, 1.5], wind.turbulence: [none, light]}"
    study = read(tmp_path, f"grid: {grid}\n")
    assert list(study.cases) == [
        "speed=1.0, turbulence=none",
        "speed=1.0, turbulence=light",
        "speed=1.5, turbulence=none",
        "speed=1.5, turbulence=light",
    ]
    assert study.cases["speed=1.5, turbulence=light"] == [
        "companion.nmpc.speed=1.5",
        'wind.turbulence="light"',
    ]
    cells = studies.cells(study, tmp_path / "out", 1, 0, True)
    assert len({c.campaign.folder for c in cells}) == 4


def test_the_grid_is_flown_for_each_case(tmp_path):
    cases = "{orca: [companion.controller=orca]}"
    study = read(tmp_path, f"cases: {cases}\ngrid: {{drones.count: [3, 5]}}\n")
    assert study.cases == {
        "orca, count=3": ["companion.controller=orca", "drones.count=3"],
        "orca, count=5": ["companion.controller=orca", "drones.count=5"],
    }


def test_keys_that_end_alike_are_named_in_full(tmp_path):
    study = read(tmp_path, "grid: {drones.radius: [0.2], world.radius: [1.0]}\n")
    assert list(study.cases) == ["drones.radius=0.2, world.radius=1.0"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "cases: a study has cases, a grid, or both"),
        (
            "grid: {drones.count: []}\n",
            "mine.yaml:3:1: grid.drones.count: needs at least one value",
        ),
    ],
)
def test_a_study_without_cases_is_refused(tmp_path, text, words):
    with pytest.raises(SettingsError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize(("options", "key"), [([], "drones"), (["--study"], "grid")])
def test_the_schema_has_every_key(options, key, capsys):
    assert main(["schema", *options]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert key in schema["properties"]
    assert schema["additionalProperties"] is False
