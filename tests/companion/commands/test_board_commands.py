"""The README's commands for a board, one after the other, as far as they go without hardware."""

import pytest

from companion.__main__ import main
from tests.companion.deployment import free_ports, small_wheel


@pytest.fixture
def drones(tmp_path, monkeypatch):
    """A folder with the packaged examples, below the working directory."""
    monkeypatch.chdir(tmp_path)
    assert main(["config", "examples", "--copy", "my-drones"]) == 0
    return sorted(str(p.relative_to(tmp_path)) for p in tmp_path.glob("my-drones/*.yaml"))


def test_the_examples_are_checked_and_deployed_as_they_are(drones, tmp_path, capsys):
    assert main(["check", *drones]) == 0
    assert capsys.readouterr().err == ""
    wheel = small_wheel(tmp_path / "wheels", "1.0")
    (tmp_path / "root").mkdir()
    arguments = ["deploy", *drones, "--root", "root", "--dry-run", "--wheel", str(wheel)]
    assert main(arguments) == 0
    told = capsys.readouterr().out
    for n, line in enumerate(told.splitlines()[:3], start=1):
        assert line.startswith(f"drone{n}  root  would change")
    assert "root: release: would change: 1.0-" in told
    assert not list((tmp_path / "root").iterdir())


def test_without_a_root_each_drone_goes_to_its_own_board(drones, tmp_path, capsys):
    shell = tmp_path / "shell"
    shell.write_text('#!/bin/sh\ncat > /dev/null\necho "$1 is not there" >&2\nexit 255\n')
    shell.chmod(0o755)
    wheel = small_wheel(tmp_path / "wheels", "1.0")
    assert main(["deploy", *drones, "--wheel", str(wheel), "--rsh", str(shell)]) == 1
    told = capsys.readouterr()
    for n in (1, 2, 3):
        assert f"drone{n}  pi@drone{n}.local  failed" in told.out
        assert f"pi@drone{n}.local is not there; nothing was changed" in told.err


def test_the_doctor_looks_at_the_first_drone(drones, capsys):
    """There is neither autopilot nor camera: red, and what to do about each."""
    no_camera = ["--set", "camera.source=sim:127.0.0.1:1"]
    assert main(["doctor", "my-drones/drone1.yaml", *no_camera]) == 1
    told = capsys.readouterr().out
    assert "green  config          my-drones/drone1.yaml" in told
    assert "red    serial port     /dev/ttyAMA0 is not there" in told
    assert "red    camera          no frame source at 127.0.0.1:1" in told


def test_a_ground_station_looks_for_all_of_them(drones, capfd):
    url = f"udpin://127.0.0.1:{free_ports(1)}"
    arguments = ["--all", "--drones", "my-drones", "--url", url, "--patience", "0.5"]
    assert main(["fleet", "arm", *arguments]) == 1
    rows = capfd.readouterr().out.splitlines()[1:]
    assert [(row.split()[0], row.split("  ")[-1]) for row in rows] == [
        ("drone1", "not found"),
        ("drone2", "not found"),
        ("drone3", "not found"),
    ]
