"""What all commands of `companion` share: help, extras that are missing, Ctrl-C."""

import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from companion.__main__ import COMMANDS, main
from companion.commands.extras import EXTRAS
from tests.companion.deployment import small_wheel, write_drones

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
OPTIONAL = sorted(
    {
        requirement.partition(">")[0].partition("=")[0].replace("-", "_")
        for extra in PROJECT["optional-dependencies"].values()
        for requirement in extra
        if not requirement.startswith("swarm-companion")
    }
)
# A base install: every optional package fails to import, as where it is not there.
BASE = f"""
import sys
for name in {OPTIONAL}:
    sys.modules[name] = None
from companion.__main__ import main
"""


def in_a_base_install(code, *arguments):
    return subprocess.run(
        [sys.executable, "-c", BASE + code, *map(str, arguments)], capture_output=True, text=True
    )


def test_every_command_has_its_help_in_a_base_install():
    asked = """
for command in sys.argv[1:]:
    try:
        main([command, "--help"])
    except SystemExit as ended:
        assert ended.code == 0, command
"""
    done = in_a_base_install(asked, *COMMANDS)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_missing_extra_is_one_line_with_the_pip_command(tmp_path):
    write_drones(tmp_path / "drones", ["one"])
    fleet = ["fleet", "status", "--all", "--drones", tmp_path / "drones"]
    done = in_a_base_install("sys.exit(main(sys.argv[1:]))", *fleet)
    assert done.returncode == 2
    assert done.stderr == "not installed: mavsdk; pip install 'swarm-companion[fleet]'\n"
    ground = ["ground", "--drones", tmp_path / "drones"]
    done = in_a_base_install("sys.exit(main(sys.argv[1:]))", *ground)
    assert done.returncode == 2
    assert done.stderr == "not installed: tornado; pip install 'swarm-companion[ground]'\n"


def test_a_base_install_flies_and_without_a_compiler_names_the_extra(tmp_path):
    (drone,) = write_drones(tmp_path / "drones", ["one"])
    solver = """
import os
from companion.control.nmpc import Nmpc, NmpcConfig
print(Nmpc(NmpcConfig()).backend)
os.environ["PATH"], os.environ["CC"] = "/nowhere", ""
import companion.process.daemon
companion.process.daemon.Daemon = lambda config: Nmpc(config.nmpc)  # without camera and vehicle
sys.exit(main(["run", sys.argv[1]]))
"""
    done = in_a_base_install(solver, drone)
    if shutil.which("gcc") or shutil.which("cc"):
        assert done.stdout == "compiled\n"
    assert done.returncode == 78  # systemd leaves it
    assert (
        "not installed: piqp; pip install 'swarm-companion[piqp]', or a C compiler" in done.stderr
    )
    assert "Traceback" not in done.stderr


def test_the_packaged_network_names_its_extra(tmp_path):
    (drone,) = write_drones(tmp_path / "drones", ["one"], "sensing: {obstacles: network}\n")
    done = in_a_base_install("sys.exit(main(['check', sys.argv[1]]))", drone)
    assert done.returncode == 2
    assert (
        "not installed: onnxruntime; pip install 'swarm-companion[eyes]'"
        in done.stdout + done.stderr
    )


@pytest.mark.parametrize(("module", "extra"), EXTRAS.items())
def test_the_extra_that_is_named_installs_the_module(module, extra):
    assert any(r.startswith(module) for r in PROJECT["optional-dependencies"][extra])


def test_a_module_that_no_extra_installs_is_a_bug_and_shows(monkeypatch):
    def run(options):
        raise ModuleNotFoundError("No module named 'companion.gone'", name="companion.gone")

    monkeypatch.setattr("companion.commands.schema.run", run)
    with pytest.raises(ModuleNotFoundError, match=r"companion\.gone"):
        main(["schema"])


def interrupted(arguments, begun, folder):
    """Start a command and press Ctrl-C once `begun` is true; its status and what it said."""
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", *map(str, arguments)],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a foreground job of its own, as in a terminal
    )
    while not begun(folder, process):
        assert process.poll() is None
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    try:
        said = process.communicate(timeout=20.0)[1]
    finally:
        process.kill()
    return process.returncode, said


def has_run(folder, process):
    """Return whether a process has used 0.3 s of processor time: Python runs by then."""
    used = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, used)) > 0.3 * os.sysconf("SC_CLK_TCK")


def has_called(folder, process):
    """Return whether a process has come as far as the remote shell."""
    return (folder / "called").exists()


@pytest.mark.parametrize(
    ("arguments", "begun", "more"),
    [
        (["fleet", "status", "--all", "--drones", "drones", "--patience", "60"], has_run, ""),
        (
            [
                "deploy",
                "drones/one.yaml",
                "--host",
                "board",
                "--rsh",
                "./sleep",
                "--wheel",
                "WHEEL",
            ],
            has_called,
            ": a board that was being installed may go on; deploy again",
        ),
    ],
)
def test_ctrl_c_is_one_line_and_status_130(tmp_path, arguments, begun, more):
    write_drones(tmp_path / "drones", ["one"])
    wheel = small_wheel(tmp_path / "wheels", "1.0")
    (tmp_path / "sleep").write_text("#!/bin/sh\ntouch called\nexec sleep 60\n")
    (tmp_path / "sleep").chmod(0o755)
    arguments = [str(wheel) if a == "WHEEL" else a for a in arguments]
    status, said = interrupted(arguments, begun, tmp_path)
    assert said == f"interrupted{more}\n"
    # Python ends itself by the signal where it came inside an import: the same 130 for a shell.
    assert status in (130, -signal.SIGINT)


def test_ctrl_c_at_a_terminal(monkeypatch, capsys):
    def run(options):
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.commands.schema.run", run)
    assert main(["schema"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
