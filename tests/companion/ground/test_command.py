"""`companion ground` before anything is served: files of the router, the folder, the extra."""

import configparser
import os
import socket

import pytest

from companion.__main__ import main
from companion.board.logs import pull
from companion.settings.config import CompanionConfig
from tests.companion.deployment import write_drones


@pytest.mark.parametrize(
    ("endpoint", "device", "baud", "port"),
    [
        ("serial:/dev/ttyAMA0:115200", "/dev/ttyAMA0", "115200", "14541"),
        ("udpin:127.0.0.1:14600", "/dev/autopilot", "921600", "14600"),
    ],
)
def test_the_routers_file_reaches_companion_qgroundcontrol_and_page(
    tmp_path, capsys, endpoint, device, baud, port
):
    (tmp_path / "one.yaml").write_text(
        f"fileversion: 2\nname: one\nlink: {{endpoint: '{endpoint}'}}\n"
    )
    command = ["ground", "--drones", str(tmp_path), "--router-config", "192.168.1.10"]
    assert main(command) == 0
    told = capsys.readouterr().out
    file = configparser.ConfigParser()
    file.read_string(told)
    assert dict(file["UartEndpoint autopilot"]) == {"device": device, "baud": baud}
    assert (file["UdpEndpoint companion"]["port"]) == port
    assert file["UdpEndpoint qgroundcontrol"]["port"] == "14550"
    assert dict(file["UdpEndpoint ground"]) == {
        "mode": "Normal", "address": "192.168.1.10", "port": "14560",
    }  # fmt: skip
    assert ("link.endpoint" in told) is endpoint.startswith("serial")


def test_bad_input_is_one_line(tmp_path, capsys):
    assert main(["ground", "--drones", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"{tmp_path}: no drone there\n"
    write_drones(tmp_path, ["one"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{other.getsockname()[1]}"
        assert main(["ground", "--drones", str(tmp_path), "--link", link]) == 2
    assert "--link UDP 127.0.0.1:" in capsys.readouterr().err
    key = tmp_path / "key"
    assert main(["ground", "--drones", str(tmp_path), "--signing-key", str(key)]) == 2
    assert "link.signing: not set, and --signing-key is given" in capsys.readouterr().err


def test_logs_of_this_machine_are_copied_once(tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    log = {"path": str(here / "flight-{time}.mcap")}
    drone = CompanionConfig.model_validate({"name": "one", "log": log})
    assert pull(drone, tmp_path / "flights", "ssh").problem == "one: no flight log"
    for name in ("flight-1.mcap", "flight-1.tlog", "other.txt"):
        (here / name).write_text(name)
    first = pull(drone, tmp_path / "flights", "ssh")
    assert (first.count, first.newest) == (2, tmp_path / "flights" / "one" / "flight-1.mcap")
    assert pull(drone, tmp_path / "flights", "ssh").count == 0


def test_logs_of_a_board_come_through_its_shell(tmp_path, monkeypatch):
    """A stand-in for ssh: the board is this machine, its log folder another."""
    board = tmp_path / "board" / "one"
    board.mkdir(parents=True)
    monkeypatch.setattr("companion.board.logs.SERVICE_LOGS", str(tmp_path / "board"))
    shell = tmp_path / "ssh"
    shell.write_text('#!/bin/sh\n[ "$1" = pi@one ] || exit 9\nshift\neval "$*"\n')
    sudo = tmp_path / "bin/sudo"  # whoever runs this test
    sudo.parent.mkdir()
    sudo.write_text('#!/bin/sh\n[ "$1" = -n ] && shift\nexec "$@"\n')
    for program in (shell, sudo):
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{sudo.parent}:{os.environ['PATH']}")
    for name in ("a b.mcap", "a b.tlog", "state.json"):
        (board / name).write_text(name)
    drone = CompanionConfig.model_validate({"name": "one", "board": {"host": "pi@one"}})
    got = pull(drone, tmp_path / "flights", [str(shell)])
    assert (got.count, got.problem) == (2, "")
    assert got.newest.read_text() == "a b.mcap"
    assert pull(drone, tmp_path / "flights", [str(shell)]).count == 0
    other = CompanionConfig.model_validate({"name": "one", "board": {"host": "pi@two"}})
    assert "pi@two: no answer" in pull(other, tmp_path / "flights", [str(shell)]).problem
