"""`companion deploy` into root directories: idempotent, all or nothing."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from companion.__main__ import main
from companion.settings.packaged import data_folder
from tests.companion.deployment import (
    contents,
    deploy,
    files_of,
    launched,
    small_wheel,
    write_drones,
)

HOME = "opt/swarm-companion"


def test_an_empty_root_gets_everything(first):
    there = contents(first / "root")
    for name in ("alpha", "beta"):
        assert f"etc/swarm-companion/{name}/{name}.yaml" in there
        assert f"etc/swarm-companion/{name}/default.yaml" in there
        link = there[f"etc/systemd/system/swarm.target.wants/companion@{name}.service"][2]
        assert str(link) == "../companion@.service"
    assert "etc/udev/rules.d/70-swarm-companion.rules" in there
    assert launched(first / "root") == "version 1.0"


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


def test_a_second_deployment_changes_nothing(board, capsys):
    before = contents(board / "root")
    assert deploy(files_of(board), next((board / "1").iterdir()), board / "root", "--json") == 0
    outcomes = json.loads(capsys.readouterr().out)
    assert [o["changed"] for o in outcomes] == [False, False]
    after = contents(board / "root")
    del before[f"{HOME}/config.json"], after[f"{HOME}/config.json"]
    assert after == before


def test_a_dry_run_reports_and_changes_nothing(board, capsys):
    before = contents(board / "root")
    wheel = small_wheel(board / "2", "2.0")
    assert deploy(files_of(board), wheel, board / "root", "--dry-run") == 0
    assert "release: would change: 2.0-" in capsys.readouterr().out
    assert contents(board / "root") == before
    empty = board / "empty"
    empty.mkdir()
    assert deploy(files_of(board), wheel, empty, "--dry-run") == 0
    assert not list(empty.iterdir())


def test_an_upgrade_keeps_edited_files_and_rolls_back(board, capsys):
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


def test_a_renamed_drone_is_not_installed_beside_itself(board, capsys):
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


def test_files_edited_on_the_board_are_checked_too(board):
    """The new files are valid; the one that is kept on the board is not."""
    edited = board / "root/etc/swarm-companion/alpha/alpha.yaml"
    edited.write_text(edited.read_text() + "gaze: {sigma: 0.3}\n")
    refuses = "any('sigma' in open(f).read() for f in sys.argv[2:])"
    before = contents(board / "root")
    assert deploy(files_of(board), small_wheel(board / "2", "2.0", refuses), board / "root") == 1
    after = contents(board / "root")
    assert {k: v[1:] for k, v in after.items()} == {k: v[1:] for k, v in before.items()}
    assert launched(board / "root") == "version 1.0"


@pytest.mark.parametrize("name", ["default", "bridge", "bridges", "airframes"])
def test_a_drone_does_not_have_the_name_of_a_file_beside_it(tmp_path, capsys, name):
    (file,) = write_drones(tmp_path / "drones", ["alpha"])
    file.write_text(file.read_text().replace("alpha", name))
    assert deploy([file], "none.whl", tmp_path / "root") == 2
    assert f"{file}:2:1: name: {name!r} is the name of a file" in capsys.readouterr().err


def test_a_board_with_an_armed_drone_is_left_alone(board, capsys):
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
        ("mission: {auto: true}\n", ["--root", "/x"], ":5:11: mission.auto: the drone would arm"),
        (
            "mission: {commission: true}\nlog: {path: x.mcap}\n",
            ["--root", "/x"],
            ":5:11: mission.commission: the drone would not look",
        ),
        ("", [], ": board.host: is missing; or give --host or --root"),
        ("link: {system_id: 0}\n", ["--root", "/x"], ":5:1: link: stands twice"),
    ],
)
def test_drones_that_are_not_fit_for_a_board(tmp_path, capsys, more, arguments, what):
    (file,) = write_drones(tmp_path / "drones", ["alpha"], more)
    assert main(["deploy", str(file), "--wheel", "none.whl", *arguments]) == 2
    assert f"{file}{what}" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["none-1.0-py3-none-any.whl", "foo.whl", "foo-1.0.zip"])
def test_a_file_that_is_no_wheel_is_refused_before_any_change(tmp_path, capsys, name):
    files = write_drones(tmp_path / "drones", ["alpha"])
    wheel = tmp_path / name
    if not name.startswith("none"):
        wheel.write_bytes(b"")
    assert deploy(files, wheel, tmp_path / "root") == 2
    assert f"--wheel {wheel}: " in capsys.readouterr().err
    assert not (tmp_path / "root").exists()
