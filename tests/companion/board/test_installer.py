"""The installer on a board whose service manager is a stand-in: restarts, and what undoes them."""

import json
import os
import subprocess
import sys

import pytest

from companion.board.bundle import make_bundle
from companion.board.changes import InstallError, Report
from companion.board.installer import Board
from companion.board.release_file import fill_release
from companion.settings.config import load_config
from tests.companion.deployment import (
    contents,
    deploy,
    fake_systemctl,
    files_of,
    launched,
    small_wheel,
)

WAITING = "ActiveState=activating\nStatusText=waiting for camera frame"


def bundle_of(board, wheel, count=2):
    drones = [(f, load_config(f)) for f in files_of(board)[:count]]
    (board / "bundle").mkdir()
    return make_bundle(board / "bundle", drones, fill_release(board / "release", wheel))


def test_daemons_that_stay_up_are_restarted(board):
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    asked = fake_systemctl(board, WAITING)
    Board(board / "root", Report(False), asked).install(bundle)
    lines = (board / "asked").read_text().splitlines()
    assert lines[0] == "daemon-reload"
    assert [line for line in lines if line.startswith("restart")] == [
        "restart --no-block companion@alpha.service",
        "restart --no-block companion@beta.service",
    ]
    assert launched(board / "root") == "version 2.0"


def test_a_rollback_restarts_the_daemons_with_the_release_before(board):
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    asked = fake_systemctl(board, WAITING)
    Board(board / "root", Report(False), asked).install(bundle)
    (board / "asked").unlink()
    Board(board / "root", Report(False), asked).rollback(bundle)
    assert launched(board / "root") == "version 1.0"
    restarts = [s for s in (board / "asked").read_text().splitlines() if "restart" in s]
    assert restarts == [
        "restart --no-block companion@alpha.service",
        "restart --no-block companion@beta.service",
    ]


def test_a_daemon_that_does_not_start_brings_everything_back(board):
    for file in files_of(board):
        file.write_text(file.read_text() + "nmpc: {speed: 1.0}\n")
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    before = contents(board / "root")
    asked = fake_systemctl(board, "SubState=auto-restart")
    with pytest.raises(InstallError, match=r"companion@alpha\.service does not start"):
        Board(board / "root", Report(False), asked).install(bundle)
    after = contents(board / "root")
    assert {k: v[1:] for k, v in after.items()} == {k: v[1:] for k, v in before.items()}
    assert launched(board / "root") == "version 1.0"
    assert (board / "asked").read_text().splitlines()[-1] == (
        "restart --no-block companion@alpha.service"
    )


def test_a_drone_that_arms_meanwhile_is_not_restarted(board):
    """Beta arms while alpha's restart is waited for: beta flies on, alpha goes back."""
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    state = board / "root/run/swarm-companion/beta/state.json"
    arms = json.dumps({"pid": os.getpid(), "armed": True, "phase": "fly"})
    asked = fake_systemctl(board, WAITING, writes=(state, arms))
    with pytest.raises(InstallError, match=r"beta is armed \(fly\)"):
        Board(board / "root", Report(False), asked).install(bundle)
    restarts = [s for s in (board / "asked").read_text().splitlines() if "restart" in s]
    assert restarts == ["restart --no-block companion@alpha.service"] * 2
    assert launched(board / "root") == "version 1.0"


def test_a_drone_that_armed_is_not_restarted_with_the_old_release(board):
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    state = board / "root/run/swarm-companion/alpha/state.json"
    arms = json.dumps({"pid": os.getpid(), "armed": True, "phase": "fly"})
    asked = fake_systemctl(board, WAITING, writes=(state, arms))
    report = Report(False)
    with pytest.raises(InstallError, match=r"alpha is armed \(fly\)"):
        Board(board / "root", report, asked).install(bundle)
    assert (board / "asked").read_text().count("restart ") == 1
    assert "companion@alpha.service is armed by now" in report.steps[-1]["detail"]


@pytest.mark.parametrize(
    ("state", "started"),
    [
        (WAITING, False),  # the old daemon, not yet told to stop
        ("ActiveState=deactivating\nStatusText=waiting for heartbeat", True),
        ("ActiveState=active", False),
    ],
)
def test_the_old_daemon_does_not_count_as_the_new_one(board, monkeypatch, state, started):
    monkeypatch.setattr("companion.board.services.START_WITHIN", 1.0)
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    asked = fake_systemctl(board, state, starts=started)
    with pytest.raises(InstallError, match="did not start within 1 s"):
        Board(board / "root", Report(False), asked).install(bundle)


def test_the_other_drone_of_a_board_is_checked_and_restarted_too(board, capsys):
    """Both drones start from `current`: alpha alone is deployed, beta runs."""
    refuses = small_wheel(board / "2", "2.0", check="'/beta/' in str(sys.argv) and 'beta refused'")
    assert deploy(files_of(board)[:1], refuses, board / "root") == 1
    assert "beta refused; nothing was changed" in capsys.readouterr().err
    assert launched(board / "root") == "version 1.0"

    bundle = bundle_of(board, small_wheel(board / "3", "3.0"), count=1)
    stopped = {f"mavlink-bridge@{n}.service": "ActiveState=inactive" for n in ("alpha", "beta")}
    asked = fake_systemctl(board, WAITING, stopped)
    Board(board / "root", Report(False), asked).install(bundle)
    assert [s for s in (board / "asked").read_text().splitlines() if s.startswith("restart")] == [
        "restart --no-block companion@alpha.service",
        "restart --no-block companion@beta.service",
    ]


def test_the_installer_needs_only_python_itself(board):
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    command = [sys.executable, "-I", "-S", str(bundle), str(bundle), "--root", str(board / "root")]
    done = subprocess.run([*command, "--dry-run"], capture_output=True, text=True)
    report = json.loads(done.stdout)
    assert (done.returncode, done.stderr, report["ok"]) == (0, "", True)
    assert {"step": "current", "result": "would change"}.items() <= report["steps"][-2].items()
