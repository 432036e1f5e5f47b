"""Files of missions: wrong ones are one clear error."""

import json

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios import scenario as scenarios

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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "--set world.missions=FILE"),
        ("", "no file of missions"),
        ("[]", "no file of missions"),
        ('{"drone_radius": 0.1, "missions": {}}', "no file of missions"),
        (json.dumps(MISSIONS).replace("0.2]", "-1]"), "no file of missions"),
        (json.dumps(MISSIONS | {"drone_radius": -1}), "drone_radius"),
        (json.dumps(MISSIONS | {"drone_radius": float("nan")}), "drone_radius"),
        (json.dumps(MISSIONS).replace('"goal": [', '"goal": [0, '), "goals"),
    ],
)
def test_a_wrong_file_of_missions_is_one_clear_error(text, words, tmp_path):
    file = tmp_path / "wrong.json"
    file.write_text(text or "")
    given = [] if text is None else [f"world.missions={file}"]
    with pytest.raises(SettingsError, match=words) as caught:
        scenarios.load("lsc-forest", given)
    assert len(str(caught.value).splitlines()) == 1


def test_too_few_agents_are_refused(missions):
    with pytest.raises(SettingsError, match="20 agents, not 21"):
        load("lsc-forest", 0, missions, "drones.count=21")
