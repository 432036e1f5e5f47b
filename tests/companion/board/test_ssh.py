"""Deployment over a real ssh connection."""

import getpass
import os
import shutil
import subprocess

import pytest

from companion.__main__ import main
from tests.companion.deployment import (
    SshServer,
    deploy,
    free_ports,
    launched,
    small_wheel,
    sshd_path,
    write_drones,
)


@pytest.fixture
def ssh(tmp_path):
    if sshd_path() is None or shutil.which("ssh") is None:
        pytest.skip("sshd is not installed (Debian: openssh-server)")
    if (
        os.getuid()
        and subprocess.run(["sh", "-c", "sudo -n true"], stderr=subprocess.DEVNULL).returncode
    ):
        pytest.skip("a board's user who is not root needs sudo without a password")
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


@pytest.mark.parametrize("shell", ["", " ", "ssh 'x"])
def test_a_remote_shell_that_is_no_command_is_refused(tmp_path, capsys, shell):
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
