"""A command whose extra is not installed says so in one line, with the pip command, status 2."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from sitl_sim.__main__ import main
from sitl_sim.commands.extras import EXTRAS, missing_extra

ROOT = Path(__file__).parents[3]
NEEDS = {
    "run": (["run", "forest"], "sim"),
    "run orca": (["run", "forest", "--controller", "orca"], "studies"),
    "run --view": (["run", "forest", "--view"], "view"),
    "serve": (["serve", "forest"], "sim"),
    "campaign": (["campaign", "forest"], "sim"),
    "campaign orca": (["campaign", "forest", "--controller", "orca"], "studies"),
    "campaign --scheduler": (["campaign", "forest", "--scheduler", "tcp://h:1"], "cluster"),
    "study": (["study", "horizon"], "studies"),
    "commissioning": (["commissioning"], "sim"),
    "scenarios --plans": (["scenarios", "--plans", "plans"], "studies"),
    "report": (["report", "run"], "sim"),
    "frames": (["frames", "frames"], "sim"),
    "soak": (["soak"], "sim"),
    "view": (["view", "run"], "view"),
}
BASE_INSTALL = f"""
import contextlib, io, json, sys
sys.modules.update(dict.fromkeys({list(EXTRAS)}))
from sitl_sim.__main__ import main
for name, arguments in json.loads(sys.argv[1]).items():
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(arguments)
        except SystemExit as end:
            status = end.code
    print(json.dumps([name, status, out.getvalue(), err.getvalue()]))
"""


def hide(monkeypatch, extra):
    """Let the modules of one extra look as if they were not installed."""
    for module, its_extra in EXTRAS.items():
        if its_extra == extra:
            monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.parametrize("command", NEEDS)
def test_a_missing_extra_is_one_line_and_status_2(command, tmp_path, monkeypatch, capsys):
    arguments, extra = NEEDS[command]
    monkeypatch.chdir(tmp_path)
    hide(monkeypatch, extra)
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"pip install 'swarm-companion[{extra}]'" in line
    assert not list(tmp_path.iterdir())


def in_base_install(commands, folder):
    """Run commands in a process without any extra; {name: (status, stdout, stderr)}."""
    done = subprocess.run(
        [sys.executable, "-c", BASE_INSTALL, json.dumps(commands)],
        cwd=folder,
        env={"PYTHONPATH": ":".join([str(ROOT), *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: tuple(rest) for name, *rest in lines}


def test_no_command_ends_with_a_traceback_in_a_base_install(tmp_path):
    found = in_base_install({name: arguments for name, (arguments, _) in NEEDS.items()}, tmp_path)
    assert found.keys() == NEEDS.keys()
    for status, out, err in found.values():
        assert (status, out) == (2, "")
        assert len(err.splitlines()) == 1
        assert "pip install 'swarm-companion[" in err


def test_a_base_install_lists_scenarios_and_faults(tmp_path):
    asked = {name: [name] for name in ("scenarios", "faults", "--help", "--version")}
    assert all(
        (status, err) == (0, "") and out
        for status, out, err in in_base_install(asked, tmp_path).values()
    )


def test_the_table_names_the_extras_of_the_distribution():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for module, extra in EXTRAS.items():
        assert any(requirement.startswith(module) for requirement in extras[extra])


def test_a_module_that_no_extra_installs_is_an_error_of_the_program():
    assert missing_extra(ModuleNotFoundError("gone", name="sitl_sim.gone")) is None
    line = missing_extra(ModuleNotFoundError("gone", name="numba.core"))
    assert line == "not installed: numba; pip install 'swarm-companion[sim]'"


def test_a_point_cloud_names_its_extra(tmp_path):
    asked = {}
    for name in ("scan.pcd", "scan.ply"):
        (tmp_path / name).touch()
        (tmp_path / f"{name}.yaml").write_text(
            f"fileversion: 1\nname: scan\nworld: {{obstacles: {name}}}\n"
            "drones: {count: 1}\nmission: {targets: [[9.0, 0.0, 2.0]]}\n"
        )
        asked[name] = ["scenarios", f"{name}.yaml"]
    for status, _, said in in_base_install(asked, tmp_path).values():
        assert status == 2
        assert said.strip().endswith("pip install 'swarm-companion[clouds]'")
