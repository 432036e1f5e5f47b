"""A user's own PX4 or ArduCopter by path, in a scenario."""

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.hil_sensors import HilSensors
from sitl_sim.external.px4_hil import Px4Sitl
from sitl_sim.flight.own_binary import real_parameters
from sitl_sim.recording.run_folder import load_run, log_path, own_frames, salvage_ticks
from sitl_sim.scenarios.scenario import load
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame


def settings(*pairs):
    return [part for pair in pairs for part in ("--set", pair)]


def test_its_telemetry_reaches_the_companion_in_step(tmp_path, stand_in):
    """The stand-in sends attitude and place; a companion in this process ticks by them."""
    out = tmp_path / "run"
    here = settings(
        "drones.count=1",
        f"drones.binary={stand_in('px4')}",
        "mission.time_limit=1.5",
        "sensing.neighbours=truth",
        "sensing.obstacles=map",
    )
    (out / "drones" / "drone1").mkdir(parents=True)  # in which the stand-in looks for its motors
    (tmp_path / "motors.json").replace(out / "drones" / "drone1" / "motors.json")
    assert main(["run", "forest", "--in-process", "--out", str(out), *here]) == 1  # never flew
    ticks = salvage_ticks(log_path(out, "drone1"))
    assert len(ticks) >= 13
    assert all(t["own"]["q"] == pytest.approx([0.7071, 0, 0, 0.7071], abs=1e-3) for t in ticks[2:])
    assert {t["phase"] for t in ticks} <= {"wait", "arm", "takeoff"}
    run = load_run(out)  # its log is in the autopilot's own time, which began earlier
    (frame,) = own_frames(run.scenario, run.world)
    times = [t["time"] - frame.boot for t in ticks]
    assert frame.boot > 0.05
    assert min(times) >= 0.0
    assert max(times) <= 1.5


def test_a_program_that_is_no_autopilot_is_one_clear_line(tmp_path, capsys):
    script = tmp_path / "ends"
    script.write_text("#!/bin/sh\n")
    sensors = HilSensors(LocalFrame(np.zeros(3), 0.0, GeoReference()), (1,))
    with pytest.raises(ExternalError, match="ends: cannot be run: Permission denied"):
        Px4Sitl(str(script), tmp_path / "a", 1, {}, sensors)
    script.chmod(0o755)
    run = ["run", "forest", "--out", str(tmp_path / "run"), "--in-process"]
    assert main([*run, *settings("drones.count=1", f"drones.binary={script}")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "ends of vehicle 1 ended; see" in lines[0]


@pytest.mark.parametrize(
    ("autopilot", "port"), [("px4", 28400), ("ardupilot", 28410), ("betaflight", 28420)]
)
def test_a_binary_that_is_not_there_is_one_clear_line(tmp_path, capsys, autopilot, port):
    pairs = ("drones.count=1", "drones.binary=/nowhere/px4", f"drones.autopilot={autopilot}")
    pairs = (*pairs, f"wire.frame_port={port}")  # of no other test, which may run at the same time
    assert main(["run", "forest", "--out", str(tmp_path / "run"), *settings(*pairs)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines == ["drones.binary: /nowhere/px4: no such file"]


def test_a_real_arducopter_does_not_go_on_at_the_last_rates_for_long():
    flown = load("forest", ["drones.autopilot=ardupilot", "drones.binary=/x"])
    assert real_parameters(flown) == {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 0.5}
    own = ["drones.autopilot=ardupilot", "drones.binary=/x", "drones.parameters={GUID_TIMEOUT: 1}"]
    assert real_parameters(load("forest", own))["GUID_TIMEOUT"] == 1.0


def test_a_bridges_line_that_does_not_pass_through_the_simulator_has_no_faults(tmp_path, capsys):
    pairs = ("drones.count=1", "drones.autopilot=betaflight", "faults=[{kind: link_loss, at: 1}]")
    assert main(["run", "forest", "--out", str(tmp_path / "run"), *settings(*pairs)]) == 2
    assert "faults.0.kind: link_loss needs px4 or ardupilot" in capsys.readouterr().err


def test_faults_that_only_an_emulated_vehicle_can_have_are_refused(tmp_path, capsys):
    pairs = (
        "drones.count=1",
        "drones.binary=/bin/true",
        "faults=[{kind: telemetry_stale, at: 1}]",
    )
    assert main(["run", "forest", "--out", str(tmp_path / "run"), *settings(*pairs)]) == 2
    assert "telemetry_stale needs an emulated autopilot" in capsys.readouterr().err
