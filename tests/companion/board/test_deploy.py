"""Deployment: idempotent, all or nothing, into roots and over a real ssh connection."""

import getpass
import json
import os
import shutil
import subprocess
import sys

import pytest

from companion.__main__ import main
from companion.board.bundle import make_bundle
from companion.board.changes import Changes, InstallError, Report
from companion.board.installer import Board
from companion.settings.config import load_config
from companion.settings.packaged import data_folder
from tests.companion.deployment import (
    SshServer,
    contents,
    fake_systemctl,
    free_ports,
    launched,
    small_wheel,
    sshd_path,
    write_drones,
)

HOME = "opt/swarm-companion"
WAITING = "ActiveState=activating\nStatusText=waiting for camera frame"


def deploy(files, wheel, root, *more):
    return main(["deploy", *map(str, files), "--wheel", str(wheel), "--root", str(root), *more])


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A root with version 1.0 of two drones; copied by the tests that change it."""
    folder = tmp_path_factory.mktemp("first")
    files = write_drones(folder / "drones", ["alpha", "beta"])
    root = folder / "root"
    root.mkdir()
    assert deploy(files, small_wheel(folder / "1", "1.0"), root) == 0
    return folder


@pytest.fixture
def board(first, tmp_path):
    shutil.copytree(first / "root", tmp_path / "root", symlinks=True)
    shutil.copytree(first / "drones", tmp_path / "drones")
    shutil.copytree(first / "1", tmp_path / "1")
    return tmp_path


def files_of(folder):
    return [folder / "drones" / f"{n}.yaml" for n in ("alpha", "beta")]


def test_an_empty_root_gets_everything(first):
    there = contents(first / "root")
    for name in ("alpha", "beta"):
        assert f"etc/swarm-companion/{name}/{name}.yaml" in there
        assert f"etc/swarm-companion/{name}/default.yaml" in there
        link = there[f"etc/systemd/system/swarm.target.wants/companion@{name}.service"][2]
        assert str(link) == "../companion@.service"
    assert "etc/udev/rules.d/70-swarm-companion.rules" in there
    assert launched(first / "root") == "version 1.0"


def test_what_is_put_back_is_as_it_was(tmp_path):
    launcher, key, new = (tmp_path / n for n in ("launcher", "key", "new"))
    for file, mode in ((launcher, 0o755), (key, 0o600)):
        file.write_bytes(b"old")
        file.chmod(mode)
    changes = Changes()
    for file in (launcher, key, new):
        changes.write(file, b"new")
    changes.link(key, "elsewhere")
    changes.undo()
    assert not new.exists()
    assert [f.read_bytes() for f in (launcher, key)] == [b"old", b"old"]
    assert [f.stat().st_mode & 0o777 for f in (launcher, key)] == [0o755, 0o600]


def test_a_bridge_comes_with_its_drone(first, tmp_path):
    root = tmp_path / "root"
    shutil.copytree(first / "root", root, symlinks=True)
    example = data_folder("configs/drones") / "drone3.yaml"
    assert deploy([example], next((first / "1").iterdir()), root) == 0
    there = contents(root)
    assert "etc/swarm-companion/drone3/bridge.yaml" in there
    link = there["etc/systemd/system/swarm.target.wants/mavlink-bridge@drone3.service"][2]
    assert str(link) == "../mavlink-bridge@.service"
    drop_in = there["etc/systemd/system/companion@drone3.service.d/board.conf"][2]
    assert b"CPUAffinity=2-3\n" in drop_in


def test_units_are_clean_and_hardened(board):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed (Debian: systemd)")
    root = board / "root"
    shutil.copytree("/lib/systemd/system", root / "usr/lib/systemd/system", symlinks=True)
    units = sorted(p.name for p in (root / "etc/systemd/system").glob("*@.service"))
    instances = [u.replace("@", "@alpha") for u in units]
    verified = subprocess.run(
        ["systemd-analyze", "verify", f"--root={root}", *instances, "swarm.target"],
        capture_output=True,
        text=True,
    )
    assert (verified.returncode, verified.stderr) == (0, "")
    for unit in units:
        rated = subprocess.run(
            [
                "systemd-analyze",
                "security",
                "--offline=true",
                "--threshold=20",
                root / "etc/systemd/system" / unit,
            ],
            capture_output=True,
            text=True,
        )
        assert rated.returncode == 0, rated.stdout[-200:]


def test_again_changes_nothing(board, capsys):
    before = contents(board / "root")
    assert deploy(files_of(board), next((board / "1").iterdir()), board / "root", "--json") == 0
    outcomes = json.loads(capsys.readouterr().out)
    assert [o["changed"] for o in outcomes] == [False, False]
    after = contents(board / "root")
    del before[f"{HOME}/config.json"], after[f"{HOME}/config.json"]
    assert after == before


def test_dry_run_tells_and_changes_nothing(board, capsys):
    before = contents(board / "root")
    wheel = small_wheel(board / "2", "2.0")
    assert deploy(files_of(board), wheel, board / "root", "--dry-run") == 0
    assert "release: would change: 2.0-" in capsys.readouterr().out
    assert contents(board / "root") == before
    empty = board / "empty"
    empty.mkdir()
    assert deploy(files_of(board), wheel, empty, "--dry-run") == 0
    assert not list(empty.iterdir())


def test_upgrade_keeps_what_was_edited_and_rolls_back(board, capsys):
    root = board / "root"
    edited = root / "etc/swarm-companion/alpha/alpha.yaml"
    edited.write_text(edited.read_text() + "gaze: {sigma: 0.3}\n")
    log = root / "var/log/swarm-companion/alpha/flight-1.mcap"
    log.parent.mkdir(parents=True)
    log.write_text("a flight")
    for file in files_of(board):
        file.write_text(file.read_text() + "nmpc: {speed: 1.0}\n")

    assert deploy(files_of(board), small_wheel(board / "2", "2.0"), root) == 0
    assert "alpha.yaml was edited here and is kept; the new one is" in capsys.readouterr().out
    assert launched(root) == "version 2.0"
    assert "sigma" in edited.read_text()
    assert "speed" in (edited.parent / "alpha.yaml.new").read_text()
    assert "speed" in (root / "etc/swarm-companion/beta/beta.yaml").read_text()
    assert log.read_text() == "a flight"
    linked = list((root / HOME / "releases").glob("2.0-*/lib/*/site-packages/pip/__init__.py"))
    assert linked[0].stat().st_nlink > 1  # an upgrade costs no second copy of what stays

    assert deploy(files_of(board), small_wheel(board / "2", "2.0"), root, "--rollback") == 0
    assert launched(root) == "version 1.0"
    assert deploy(files_of(board), small_wheel(board / "3", "3.0"), root) == 0
    releases = sorted(p.name.split("-")[0] for p in (root / HOME / "releases").iterdir())
    assert releases == ["1.0", "3.0"]  # the one in use and the one before


def test_a_failed_upgrade_leaves_the_old_one(board, capsys):
    before = contents(board / "root")
    broken = small_wheel(board / "2", "2.0", check=1)
    assert deploy(files_of(board), broken, board / "root") == 1
    assert "version 2.0; nothing was changed" in capsys.readouterr().err
    assert contents(board / "root") == before
    assert launched(board / "root") == "version 1.0"
    assert len(list((board / "root" / HOME / "releases").iterdir())) == 1


def bundle_of(board, wheel, count=2):
    drones = [(f, load_config(f)) for f in files_of(board)[:count]]
    (board / "bundle").mkdir()
    return make_bundle(board / "bundle", drones, wheel)


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


def test_who_arms_meanwhile_is_not_restarted(board):
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


def test_what_is_put_back_is_not_restarted_where_it_armed(board):
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
def test_the_daemon_before_does_not_pass_for_the_new_one(board, monkeypatch, state, started):
    monkeypatch.setattr("companion.board.installer.START_WITHIN", 1.0)
    bundle = bundle_of(board, small_wheel(board / "2", "2.0"))
    asked = fake_systemctl(board, state, starts=started)
    with pytest.raises(InstallError, match="did not start within 1 s"):
        Board(board / "root", Report(False), asked).install(bundle)


def test_the_other_drone_of_a_board_is_tried_and_restarted_too(board, capsys):
    """`current` is theirs both: alpha alone is deployed, beta runs."""
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


def test_a_drone_renamed_does_not_stay_beside_itself(board, capsys):
    alpha = board / "drones/alpha.yaml"
    renamed = alpha.with_name("gamma.yaml")
    renamed.write_text(alpha.read_text().replace("alpha", "gamma"))
    real = f"__import__('subprocess').call([{sys.executable!r}, '-m', 'companion', *sys.argv[1:]])"
    wheel = small_wheel(board / "2", "2.0", check=real)
    before = contents(board / "root")
    assert deploy([renamed], wheel, board / "root") == 1
    told = capsys.readouterr().err
    assert "system id 1 is taken by gamma" in told
    assert "`sudo systemctl disable --now companion@alpha mavlink-bridge@alpha; sudo rm" in told
    assert contents(board / "root") == before


def test_what_was_edited_on_the_board_is_tried(board):
    """What comes is fine; what is kept there and would run is not."""
    edited = board / "root/etc/swarm-companion/alpha/alpha.yaml"
    edited.write_text(edited.read_text() + "gaze: {sigma: 0.3}\n")
    refuses = "any('sigma' in open(f).read() for f in sys.argv[2:])"
    before = contents(board / "root")
    assert deploy(files_of(board), small_wheel(board / "2", "2.0", refuses), board / "root") == 1
    after = contents(board / "root")
    assert {k: v[1:] for k, v in after.items()} == {k: v[1:] for k, v in before.items()}
    assert launched(board / "root") == "version 1.0"


@pytest.mark.parametrize("name", ["default", "bridge", "bridges", "airframes"])
def test_a_drone_is_not_named_as_what_lies_beside_it(tmp_path, capsys, name):
    (file,) = write_drones(tmp_path / "drones", ["alpha"])
    file.write_text(file.read_text().replace("alpha", name))
    assert deploy([file], "none.whl", tmp_path / "root") == 2
    assert f"{file}:2:1: name: {name!r} is the name of a file" in capsys.readouterr().err


def test_never_while_armed(board, capsys):
    run = board / "root/run/swarm-companion/alpha"
    run.mkdir(parents=True)
    state = {"pid": os.getpid(), "armed": True, "phase": "fly"}
    (run / "state.json").write_text(json.dumps(state))
    wheel = small_wheel(board / "2", "2.0")
    for more in ([], ["--rollback"], ["--dry-run"]):
        assert deploy(files_of(board), wheel, board / "root", *more) == 1
        assert "alpha is armed (fly); nothing was changed" in capsys.readouterr().err
    (run / "state.json").write_text(json.dumps(state | {"armed": False}))
    assert deploy(files_of(board), wheel, board / "root") == 0


@pytest.mark.parametrize(
    ("more", "arguments", "what"),
    [
        ("mission: {auto: true}\n", ["--root", "/x"], ":5:11: mission.auto: it would arm and take"),
        ("", [], ": board.host: is missing; or give --host or --root"),
        ("link: {system_id: 0}\n", ["--root", "/x"], ":5:1: link: stands twice"),
    ],
)
def test_what_is_not_deployed(tmp_path, capsys, more, arguments, what):
    (file,) = write_drones(tmp_path / "drones", ["alpha"], more)
    assert main(["deploy", str(file), "--wheel", "none.whl", *arguments]) == 2
    assert f"{file}{what}" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["none-1.0-py3-none-any.whl", "foo.whl", "foo-1.0.zip"])
def test_what_is_no_wheel_is_told_before_anything_is_done(tmp_path, capsys, name):
    files = write_drones(tmp_path / "drones", ["alpha"])
    wheel = tmp_path / name
    if not name.startswith("none"):
        wheel.write_bytes(b"")
    assert deploy(files, wheel, tmp_path / "root") == 2
    assert f"--wheel {wheel}: " in capsys.readouterr().err
    assert not (tmp_path / "root").exists()


@pytest.mark.parametrize("shell", ["", " ", "ssh 'x"])
def test_what_is_no_remote_shell_is_told(tmp_path, capsys, shell):
    (file,) = write_drones(tmp_path / "drones", ["alpha"])
    with pytest.raises(SystemExit) as ended:
        main(["deploy", str(file), "--host", "board", "--rsh", shell])
    assert ended.value.code == 2
    assert f"--rsh: must be a command, its quotes closed, got {shell!r}" in capsys.readouterr().err


def test_a_board_that_answers_in_latin_1_has_its_row(tmp_path, capsys):
    files = write_drones(tmp_path / "drones", ["alpha"])
    shell = tmp_path / "shell"
    shell.write_bytes("#!/bin/sh\necho 'sudo: Passwort benötigt' >&2\nexit 1\n".encode("latin-1"))
    shell.chmod(0o755)
    wheel = small_wheel(tmp_path / "1", "1.0")
    assert deploy(files, wheel, tmp_path, "--host", "board", "--rsh", str(shell)) == 1
    assert "Passwort ben\ufffdtigt; nothing was changed" in capsys.readouterr().err


@pytest.fixture
def ssh(tmp_path):
    if sshd_path() is None or shutil.which("ssh") is None:
        pytest.skip("sshd is not installed (Debian: openssh-server)")
    folder = tmp_path / "ssh"
    folder.mkdir()
    server = SshServer(folder, free_ports(1))
    yield server
    server.close()


def test_a_fleet_over_ssh(tmp_path, ssh, capsys):
    """One board answers, the other is not there: each has its own line, one does not stop both."""
    user = getpass.getuser()
    files = write_drones(tmp_path / "drones", ["alpha", "beta"])
    for file, host in zip(files, ("127.0.0.1", "127.0.0.2"), strict=True):
        file.write_text(file.read_text() + f"board: {{host: {user}@{host}}}\n")
    root, wheel = tmp_path / "root", small_wheel(tmp_path / "1", "1.0")
    root.mkdir()
    remote = ["--rsh", ssh.shell, "--remote-root", str(root)]
    arguments = ["deploy", *map(str, files), "--wheel", str(wheel), *remote]

    assert main(arguments) == 1
    told = capsys.readouterr()
    assert [line.split()[:3] for line in told.out.splitlines()[:2]] == [
        ["alpha", f"{user}@127.0.0.1", "done"],
        ["beta", f"{user}@127.0.0.2", "failed"],
    ]
    assert "Connection refused; nothing was changed" in told.err
    assert launched(root) == "version 1.0"
    assert not (root / "etc/swarm-companion/beta").exists()

    assert main([*arguments, "--host", f"{user}@127.0.0.1"]) == 0  # both on the board that is there
    assert (root / "etc/swarm-companion/beta/beta.yaml").exists()
    assert "unchanged" not in capsys.readouterr().out
    assert main([*arguments, "--host", f"{user}@127.0.0.1"]) == 0
    assert capsys.readouterr().out.count("unchanged") == 2
