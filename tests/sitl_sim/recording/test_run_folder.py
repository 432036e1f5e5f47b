"""Reading a run folder: complete ones, and every mistake as one line."""

import contextlib
import json

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.recording.run_folder import load_run, radii
from sitl_sim.viewer import Page, Replay
from tests.sitl_sim import flights

FRAME = {"origin": [0.0, 0.0, 0.0], "yaw": 0.0, "boot": 7.0}


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: d.rename(d.with_name("gone")), "no such run folder"),
        (lambda d: (d / "world.json").unlink(), "world.json: cannot be read"),
        (lambda d: (d / "world.json").write_text("[]"), "world.json: not a world"),
        (lambda d: (d / "metrics.json").write_text(""), "metrics.json: no metrics of a flight"),
        (lambda d: (d / "metrics.json").write_text("[1]"), "metrics.json: no metrics of a flight"),
        (
            lambda d: world(d, cylinders=[{"x": 1.0, "y": 2.0}]),
            "an obstacle or a frame lacks 'radius'",
        ),
        (lambda d: world(d, frames={"drone1": {"yaw": 0}}), "or a frame lacks 'origin'"),
        (lambda d: world(d, frames={"drone1": FRAME}), "no frame of drone2, drone3"),
        (lambda d: world(d, boxes=[{"min": [0, 0, 0]}]), "an obstacle or a frame lacks 'max'"),
        (lambda d: world(d, targets=[[1, 2, 3]]), "world.json: not a world"),
        (lambda d: world(d, targets={"*": [[1, 2]]}), "world.json: not a world"),
        (lambda d: world(d, target_tolerance=[]), "world.json: not a world"),
        (lambda d: (d / "truth.npz").write_bytes(b""), "truth.npz: empty, foreign or cut off"),
        (lambda d: (d / "truth.npz").write_text("hello"), "truth.npz: empty, foreign or cut off"),
        (lambda d: cut(d / "truth.npz"), "truth.npz: empty, foreign or cut off"),
        (lambda d: np.savez(d / "truth.npz", a=1), "truth.npz: lacks"),
        (lambda d: (d / "scenario.yaml").unlink(), "scenario.yaml: cannot be read"),
        (lambda d: (d / "drones/drone2/flight.mcap").unlink(), "flight.mcap: cannot be read"),
        (lambda d: (d / "drones/drone2/flight.mcap").write_text(""), "flight.mcap: empty"),
        (lambda d: (d / "drones/drone2/flight.mcap").write_text("x"), "flight.mcap: not an MCAP"),
        (lambda d: cut(d / "drones/drone2/flight.mcap"), "flight.mcap: cut off"),
    ],
)
def test_a_damaged_folder_is_one_clear_line_and_status_2(tmp_path, capsys, spoil, words):
    folder = flights.write_run(tmp_path / "run")
    spoil(folder)
    assert main(["report", str(folder)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert words in lines[0]


def test_missing_values_of_a_world_have_the_judges_defaults(tmp_path):
    """No tolerance is 1.5 m, no height is without end, `*` are the targets of all others."""
    folder = flights.write_run(tmp_path / "run")
    whole = load_run(folder)
    shared = {"*": [[9.0, 0.0, 2.0]], "drone2": whole.world["targets"]["drone2"]}
    world(
        folder,
        target_tolerance=None,
        targets=shared,
        cylinders=[
            {"x": 3.0, "y": 6.0, "radius": 0.5},
            {"x": 5.0, "y": 6.0, "radius": 0.5, "height": None},
        ],
    )
    run = load_run(folder)
    assert run.world["target_tolerance"] == 1.5
    assert run.world["targets"] == {
        "drone1": shared["*"],
        "drone2": shared["drone2"],
        "drone3": shared["*"],
    }
    assert [c["height"] for c in run.world["cylinders"]] == [np.inf] * 2
    assert main(["report", str(folder)]) == 0
    assert "drone2 1/1" in (folder / "report.html").read_text()
    with contextlib.closing(Page(Replay(run), port=0)):
        pass  # drawn, however tall


def test_sizes_by_name_are_read(tmp_path):
    folder = flights.write_run(tmp_path / "run")
    world(folder, drone_radius={"drone1": 0.1, "drone2": 0.3})
    told = load_run(folder).world
    assert told["drone_radius"] == 0.3
    np.testing.assert_array_equal(radii(told, ["drone2", "drone1"]), [0.3, 0.1])


def test_a_folder_without_a_flight_is_refused(tmp_path, capsys):
    assert main(["report", str(tmp_path)]) == 2
    assert "world.json: cannot be read" in capsys.readouterr().err


def world(folder, **changes):
    """Change world.json; what is None there is left out."""
    path = folder / "world.json"
    told = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({k: v for k, v in told.items() if v is not None}))


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
