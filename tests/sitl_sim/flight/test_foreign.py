"""A flight among foreign drones, one of them in the way: flown, judged and shown without them."""

import contextlib
import json

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.api import load_flight
from sitl_sim.figures.events import events
from sitl_sim.flight.results import finish, table
from sitl_sim.flight.runner import flight
from sitl_sim.recording.run_folder import load_run
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.viewer import Page, Replay

pytestmark = pytest.mark.timeout(900)  # a flight, on a loaded machine


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """drone2 is ours; drone1 hovers on its way, drone3 flies with another controller beside it."""
    folder = tmp_path_factory.mktemp("foreign")
    scenario = Scenario.model_validate(
        {
            "name": "among foreign drones",
            "drones": {
                "count": 3,
                "starts": [[3.5, 0.0], [0.0, 0.0], [0.0, 6.0]],
                "jitter": 0.0,
                "heading_deg": 0.0,
                "foreign": {"drone1": {"does": "hover"}, "drone3": {"does": "vasarhelyi"}},
            },
            "mission": {
                "targets_of": {"drone2": [[7.0, 0.0, 2.0]], "drone3": [[40.0, 6.0, 2.0]]},
                "home": False,
                "tolerance": 1.0,
                "time_limit": 40.0,
            },
            "sensing": {"neighbours": "truth", "obstacles": "map", "width": 64, "height": 64},
        }
    )
    with flight(scenario, folder, in_process=True) as f:
        f.write_inputs()
        f.launch()
        f.wait_for_companions()
        f.run()
    return folder, finish(f, 0.0)


def test_ours_gets_by_and_nobody_waits_for_the_others(flown):
    folder, metrics = flown
    truth = load_flight(folder)
    assert metrics["ok"], table(metrics, folder)
    assert metrics["targets_reached"] == {"drone2": "1/1"}
    assert metrics["duration_s"] < 30.0  # drone1 stays up, drone3 is still on its way
    assert truth.position[-1, ::2, 2].min() > 1.5
    assert np.linalg.norm(truth.position[-50:, 0] - [3.5, 0.0, 2.0], axis=1).max() < 0.4
    distance = np.linalg.norm(truth.position[:, 0] - truth.position[:, 1], axis=1)
    assert metrics["min_agent_distance_m"] == pytest.approx(distance.min(), abs=1e-6)
    assert distance.min() < 2.0  # it was in the way


def test_the_figures_are_ours_and_name_the_others(flown):
    folder, metrics = flown
    assert metrics["foreign"] == ["drone1", "drone3"]
    assert metrics["drones"] == 3
    assert set(metrics["per_drone"]) == {"drone2", "drone3"}  # those with companions
    assert metrics["tick_ms"] == metrics["per_drone"]["drone2"]["tick_ms"]
    assert "1 of 1" in table(metrics, folder)
    world = json.loads((folder / "world.json").read_text())
    assert world["foreign"] == ["drone1", "drone3"]
    assert set(world["targets"]) == {"drone2"}


def test_a_drone_without_a_companion_has_neither_configuration_nor_log(flown):
    folder, _ = flown
    assert not (folder / "drones" / "drone1").exists()
    run = load_run(folder)
    assert run.logs["drone1"] == []
    assert run.logs["drone3"]
    assert "drone1" not in {e.drone for e in events(run) if e.kind == "silence"}
    assert load_flight(folder).ticks("drone1") == []
    text = (folder / "drones" / "drone3" / "config.yaml").read_text()
    assert "controller: vasarhelyi" in text


def test_a_log_that_should_be_there_is_missed(flown, tmp_path, capsys):
    folder, _ = flown
    for file in ("scenario.yaml", "world.json", "truth.npz"):
        (tmp_path / file).write_bytes((folder / file).read_bytes())
    assert main(["report", str(tmp_path)]) == 2
    assert "drone2/flight.mcap: cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ["report"],
        ["export", "--to", "mcap"],
        ["export", "--to", "csv"],
        ["figures"],
        ["video", "--start", "8", "--end", "8.3", "--width", "320"],
    ],
)
def test_every_command_shows_such_a_flight(flown, command, capsys):
    folder, metrics = flown
    assert main([command[0], str(folder), *command[1:]]) == 0, capsys.readouterr().err
    if "mcap" in command:
        layout = json.loads((folder / "swarm.foxglove.json").read_text())
        image = layout["configById"]["Image!camera"]["imageMode"]
        assert image["imageTopic"] == "/truth/drone2/camera"  # drone1 has none
    if command == ["report"]:
        page = (folder / "report.html").read_text()
        assert "The drone reached all targets in" in page
        assert "and touched nothing, among 2 foreign drones." in page
        assert load_run(folder).metrics["foreign"] == metrics["foreign"]


def test_the_viewer_shows_such_a_flight(flown):
    folder, _ = flown
    with contextlib.closing(Page(Replay(load_run(folder)), port=0)) as page:
        page.show(9.0)
