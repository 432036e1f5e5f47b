"""The doctor: green for a good vehicle; each fault with its name and what to do."""

import json
from contextlib import closing

import pytest

from companion.__main__ import main
from companion.doctor import Level, camera, machine, vehicle
from companion.doctor.finding import rated
from companion.process.vehicle_lock import VehicleLock
from companion.settings.config import CompanionConfig, load_config
from tests.companion.deployment import free_ports
from tests.companion.patience import PATIENCE

# What a machine that runs other things beside this test may lack, by wall time.
BY_LOAD = {"speed", "frame rate", "attitude rate", "position rate", "clock"}


def by_name(findings):
    return {f.name: f for f in findings}


def test_a_good_board(world, capsys):
    config = world.config(1, more="airframe: {hover_thrust: 0.33}\n")
    status = main(["doctor", "--json", str(config), "--set", f"log.path={world.folder}/a.mcap"])
    report = json.loads(capsys.readouterr().out)
    levels = {f["name"]: f["level"] for f in report["findings"]}
    for name in ("config", "software", "log", "vehicle", "silence", "hover thrust"):
        assert levels[name] == "green", report
    red = {name for name, level in levels.items() if level == "red"}
    assert red <= BY_LOAD, report
    assert levels.keys() >= BY_LOAD, report
    assert status == (1 if red else 0)
    assert all(f["todo"] for f in report["findings"] if f["level"] != "green")


def test_a_red_finding_sets_the_exit_status_and_says_what_to_do(world, capsys):
    config = world.config(1)
    arguments = ["doctor", str(config), "--set", "link.autopilot=ardupilot"]
    assert main([*arguments, "--set", f"log.path={world.folder}/a.mcap"]) == 1
    told = capsys.readouterr().out
    assert "red    vehicle" in told
    assert "vehicle 1 is px4" in told
    assert "→ correct link.autopilot, or the vehicle" in told


def test_a_vehicle_that_is_not_there(world):
    config = load_config(world.config(1), ["link.endpoint=udpin:127.0.0.1:0"])
    (finding,) = vehicle.examine(config, hover_known=True)
    assert finding.level is Level.RED
    assert "no heartbeat of system 1" in finding.text


def test_a_port_that_a_daemon_holds(world, start_daemon):
    file = world.config(2)
    daemon = start_daemon(file)
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    (finding,) = vehicle.examine(load_config(file), hover_known=True)
    assert finding.level is Level.RED
    assert "systemctl stop companion@drone2" in finding.todo


def test_the_link_of_a_daemon_is_left_alone():
    """On a serial line each byte has one reader."""
    config = CompanionConfig(link={"endpoint": f"udpin:127.0.0.1:{free_ports(1)}"})
    with closing(VehicleLock(f"{config.link.endpoint}#{config.link.system_id}")):
        (finding,) = vehicle.examine(config, hover_known=True)
    assert (finding.level, finding.name) == (Level.RED, "link")
    assert "flown by another daemon already" in finding.text


@pytest.mark.parametrize(
    ("key", "level", "text"),
    [
        ("none/key", Level.RED, "No such file"),
        ("swarm.key", Level.AMBER, "a credential"),
        ("{folder}/key", Level.GREEN, "key"),
    ],
)
def test_the_signing_key(tmp_path, key, level, text):
    (tmp_path / "key").write_bytes(bytes(range(32)))
    (tmp_path / "key").chmod(0o600)
    link = {"signing": {"key": key.format(folder=tmp_path)}}
    finding = by_name(machine.examine(CompanionConfig.model_validate({"link": link})))
    assert finding["signing key"].level is level
    assert text in finding["signing key"].text


def test_a_camera_that_is_not_there(world):
    config = load_config(world.config(1), ["camera.source=sim:127.0.0.1:1"])
    found = by_name(camera.examine(config))
    assert found["camera"].level is Level.RED
    assert "no frame source at 127.0.0.1:1" in found["camera"].text


@pytest.mark.parametrize(
    ("calibration", "level", "text"),
    [
        ("width: 64\nheight: 64\nfx: 20\nfy: 20\ncx: 31\ncy: 31\n", Level.GREEN, "64×64"),
        ("width: 640\nheight: 400\nfx: 229\nfy: 229\ncx: 31\ncy: 31\n", Level.RED, "640×400"),
        ("width: 64\n", Level.RED, "missing height"),
    ],
)
def test_calibration_must_fit(world, calibration, level, text):
    (world.folder / "lens.yaml").write_text(calibration)
    config = load_config(world.config(3), [f"camera.calibration={world.folder}/lens.yaml"])
    finding = by_name(camera.examine(config))["calibration"]
    assert finding.level is level
    assert text in finding.text


def test_the_machine(tmp_path):
    file = tmp_path / "one.yaml"
    file.write_text("fileversion: 2\n")
    gone = ["log.path=/nowhere/a.mcap", "link.endpoint=serial:/dev/nothing:115200"]
    found = by_name(machine.examine(load_config(file, gone)))
    assert found["log"].level is Level.RED
    assert found["serial port"].level is Level.RED
    assert "/dev/nothing is not there" in found["serial port"].text
    assert "ms a tick" in found["speed"].text
    assert by_name(machine.examine(load_config(file)))["log"].level is Level.AMBER


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (["camera.calibration=none.yaml"], "none.yaml"),
        (["sensing.detector=cnn", "sensing.model=none.onnx"], "none.onnx"),
    ],
)
def test_the_speed_is_not_measured_without_the_files_it_needs(tmp_path, wrong, named):
    file = tmp_path / "one.yaml"
    file.write_text("fileversion: 2\n")
    speed = by_name(machine.examine(load_config(file, wrong)))["speed"]
    assert speed.level is Level.AMBER
    assert named in speed.text
    assert speed.todo


def test_limits():
    levels = [rated("x", v, (1.0, 2.0), "", "do").level for v in (1.0, 1.5, 2.5)]
    assert levels == [Level.GREEN, Level.AMBER, Level.RED]
