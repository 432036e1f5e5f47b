"""The packaged set of instances and the benchmark on it: figures do not get worse."""

import contextlib
import json

import numpy as np
import pytest

from companion.__main__ import main
from companion.bench.situations import drawn, windows
from companion.bench.solver import bench, within_bounds
from companion.bench.solver_table import Goal, goals, table
from companion.bench.tick import stored as stored_flight
from companion.control.nmpc import Neighbour, Nmpc, NmpcConfig
from companion.control.nmpc.instance_file import InstancesError, Run, load, save, stored
from companion.flightlog.reader import read_log
from tests.companion.control.nmpc.scenes import CONFIG, random_scene, scene


def test_stored_set():
    runs = load(stored(), CONFIG)
    assert sum(len(r.instances) for r in runs) >= 200
    assert {r.flight for r in runs} >= {"forest", "crossing"}
    assert all(i.finite() for r in runs for i in r.instances)


def test_report():
    report = bench(load(stored(), CONFIG)[::6], solvers=["rti", "ipopt-sx"], ticks=100)
    rti, reference = report["solvers"]["rti"], report["solvers"]["ipopt-sx"]
    assert rti["success"] == rti["within_bounds"] == 1.0
    assert rti["worse_percent"]["p50"] <= 0.05
    assert rti["worse_percent"]["max"] <= 1.5
    # Times are only compared with each other, as the machine is shared.
    assert (
        reference["warm_ms"]["p50"] > 5 * rti["warm_ms"]["p50"]
        or Nmpc(CONFIG).backend != "compiled"
    )
    assert json.loads(json.dumps(report)) == report
    assert "rti: largest over median" in table(report)
    assert rti["endurance"]["ticks"] == 100
    assert rti["endurance"]["growth_mb"] < 5.0
    assert {g.name.split(":")[0] for g in goals(report)} == {"rti"}


def test_verdicts():
    said = [Goal("x", value, 1.0, 2.0).verdict for value in (1.0, 1.5, 2.5)]
    assert said == ["reached", "accepted", "missed"]
    assert Goal("x", 1.5, 1.0).verdict == "missed"


def test_a_plan_out_of_bounds_is_found():
    instance = random_scene(1)
    result = Nmpc(CONFIG).solve(instance)
    assert within_bounds(CONFIG, instance, result)
    result.u[3, 0] += CONFIG.delta_c_max + 0.1
    assert not within_bounds(CONFIG, instance, result)


def test_command(tmp_path, capsys):
    save(tmp_path / "set.npz", [Run("mine", "a", (random_scene(1), random_scene(2)))])
    arguments = ["bench", "nmpc", "--instances", str(tmp_path / "set.npz"), "--solver", "rti"]
    assert main([*arguments, "--ticks", "3", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["instances"] == 2
    assert list(report["solvers"]["rti"]["worse_percent_by_flight"]) == ["mine"]
    assert main([*arguments, "--set", "N=0"]) == 2
    assert "N" in capsys.readouterr().err
    assert main(["bench", "nmpc", "--instances", str(tmp_path / "none.npz")]) == 2
    assert "none.npz" in capsys.readouterr().err


def test_windows_are_named_by_their_hardest_situation():
    others = {
        "easy": {},
        "inside": {"neighbours": [Neighbour((0.5, 0, 2), (0, 0, 0))]},
        "head-on": {"neighbours": [Neighbour((4, 0, 2), (-2, 0, 0))]},
        "crowded": {
            "neighbours": [Neighbour((2, 0, 2), (0, 0, 0)), Neighbour((0, 2, 2), (0, 0, 0))],
            "cylinders": [(-3, 0, 1)],
        },
    }
    ticks = [scene(**changes) for changes in ({}, *others.values()) for _ in range(6)]
    found = windows("mine", ticks, CONFIG)
    assert [run.kind for run in found] == ["cold", *others]
    assert all(run.flight == "mine" and len(run.instances) == 6 for run in found)
    assert len(drawn(found * 3, 2, seed=1)) == 10


def test_recorded_from_a_flight_log(tmp_path, capsys):
    log = stored_flight()
    assert main(["bench", "record", str(tmp_path / "set.npz"), f"mine={log}"]) == 0
    assert "cold" in capsys.readouterr().out
    assert all(i.finite() for run in load(tmp_path / "set.npz", CONFIG) for i in run.instances)
    assert main(["bench", "record", str(tmp_path / "set.npz"), str(log)]) == 2
    assert "FLIGHT=LOG" in capsys.readouterr().err


def test_a_log_that_cannot_be_recorded_is_refused(tmp_path, capsys, monkeypatch):
    """A calibration that is not on this machine; a folder that does not exist."""
    file = stored_flight()
    to, named = tmp_path / "none" / "set.npz", f"mine={file}"
    assert main(["bench", "record", str(to), named]) == 2
    assert f"{to}: cannot be written: no folder {to.parent}" in capsys.readouterr().err
    log = read_log(file)
    log.config["camera"]["calibration"] = "none.yaml"
    monkeypatch.setattr("companion.flightlog.reader.read_log", lambda _: log)
    assert main(["bench", "record", str(tmp_path / "set.npz"), named]) == 2
    assert "none.yaml: cannot read calibration" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nmpc", "--every", "0"], "--every: must be 1 or more, got '0'"),
        (["nmpc", "--ticks", "-1"], "--ticks: must be 0 or more, got '-1'"),
        (["record", "set.npz", "a=b", "--each", "none"], "--each: must be 1 or more, got 'none'"),
        (["record", "set.npz", "a=b", "--seed", "-1"], "--seed: must be 0 or more, got '-1'"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", *arguments])
    assert ended.value.code == 2
    assert words in capsys.readouterr().err


def test_round_trip(tmp_path):
    runs = [
        Run("x", "a", (random_scene(1), random_scene(2))),
        Run("y", "b", (random_scene(3),)),
    ]
    save(tmp_path / "set.npz", runs)
    again = load(tmp_path / "set.npz", CONFIG)
    assert [(r.flight, r.kind, len(r.instances)) for r in again] == [("x", "a", 2), ("y", "b", 1)]
    np.testing.assert_array_equal(again[1].instances[0].x0, random_scene(3).x0)


def test_other_sizes_are_padded_and_cut(tmp_path):
    save(tmp_path / "set.npz", [Run("x", "a", (random_scene(1),))])
    config = NmpcConfig(cylinders=3, neighbours=5)
    instance = load(tmp_path / "set.npz", config)[0].instances[0]
    assert instance.cylinders.shape == (3, 3)
    assert instance.neighbour_active.tolist() == [1, 1, 1, 0, 0]


def test_a_file_without_an_array_is_refused_by_its_name(tmp_path):
    np.savez(tmp_path / "set.npz", sequence=np.zeros(1), x0=np.zeros((1, 10)))
    with pytest.raises(InstancesError, match="u_last"):
        load(tmp_path / "set.npz", CONFIG)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("goal", np.zeros((1, 2))),
        ("yaw", np.array(["north"])),
        ("cylinders", np.zeros((1, 3))),
        ("sequence", np.array(3)),
        ("sequence", np.zeros(0)),
        ("flight", np.array("x")),
    ],
)
def test_an_array_that_does_not_fit_is_refused_by_its_name(name, value, tmp_path):
    save(tmp_path / "set.npz", [Run("x", "a", (random_scene(1),))])
    with np.load(tmp_path / "set.npz") as data:
        arrays = dict(data)
    np.savez(tmp_path / "set.npz", **{**arrays, name: value})
    with pytest.raises(InstancesError, match=name):
        load(tmp_path / "set.npz", CONFIG)


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_file_is_one_error(seed, tmp_path):
    """Cut short, empty, or with a byte changed: refused, or read where the byte has no effect."""
    save(tmp_path / "set.npz", [Run("x", "a", (random_scene(1),))])
    data, rng = bytearray((tmp_path / "set.npz").read_bytes()), np.random.default_rng(seed)
    if seed < 3:
        data = data[: [0, 30, len(data) // 2][seed]]
    else:
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 255))
    (tmp_path / "set.npz").write_bytes(bytes(data))
    with contextlib.suppress(InstancesError):
        assert len(load(tmp_path / "set.npz", CONFIG)) == 1
        assert seed >= 3
