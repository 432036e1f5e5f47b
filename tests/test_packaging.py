"""The way in: the wheel without extras, completion, container file, public CI, SBOM."""

import importlib.metadata as metadata
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import companion.commands.run
import sitl_sim.commands.exit_status
from companion.board.wheelhouse import LOCKS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MAKE_TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def required(names, found=None):
    """Return the distributions that these names require here, without extras, all the way down."""
    found = {} if found is None else found
    for requirement in map(Requirement, names):
        if requirement.name not in found and (
            requirement.marker is None or requirement.marker.evaluate({"extra": ""})
        ):
            found[requirement.name] = there = metadata.distribution(requirement.name)
            required(there.requires or [], found)
    return found


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """The programs of a base install: the wheel, and links to what it requires and nothing more."""
    folder = tmp_path_factory.mktemp("base")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", str(ROOT)]
    subprocess.run([*build, "--wheel-dir", str(folder)], check=True)
    (wheel,) = folder.glob("swarm_companion-*.whl")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    python = folder / "venv/bin/python"
    install = ["pip", "--python", str(python), "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([sys.executable, "-m", *install, str(wheel)], check=True)
    (packages,) = (folder / "venv").glob("lib/python3*/site-packages")
    for there in required(PROJECT["dependencies"]).values():
        tops = {f.parts[0] for f in there.files if f.parts[0] not in ("..", "__pycache__")}
        for top in tops:
            if not (packages / top).exists():
                (packages / top).symlink_to(there.locate_file(top))
    return folder / "venv/bin"


def run(program, *arguments, **more):
    environment = {"PATH": os.environ["PATH"], "HOME": str(program.parent)}
    return subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, env=environment, **more
    )


def test_the_same_tree_makes_the_same_wheel_wherever_and_whenever(tmp_path):
    """In two folders, by files of other times and rights, a whole build each; no network."""
    listed = ["git", "-C", ROOT, "ls-files", "-z", "--", ":!docs", ":!tests", ":!training"]
    files = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    environment = {k: v for k, v in os.environ.items() if k != "SOURCE_DATE_EPOCH"}
    made = []
    for folder, age, mode in (("a", 0.0, 0o644), ("in/another folder", 4e7, 0o664)):
        tree = tmp_path / folder
        for name in filter(None, files.split("\0")):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, tree / name)
            (tree / name).chmod(mode)
            os.utime(tree / name, (1.7e9 - age, 1.7e9 - age))
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", "out"]
        subprocess.run(command, cwd=tree, env=environment, check=True, capture_output=True)
        (wheel,) = (tree / "out").glob("*.whl")
        made.append((wheel.name, wheel.read_bytes()))
    assert made[0] == made[1]
    assert f"swarm_companion-{PROJECT['version']}-" in made[0][0]


@pytest.mark.parametrize("name", PROJECT["scripts"])
def test_every_program_of_the_wheel_starts(base, name):
    assert run(base / name, "--version").stdout.strip() == metadata.version("swarm-companion")
    assert run(base / name, "--help").returncode == 0


def test_the_wheel_works_without_extras_or_names_the_extra(base, tmp_path):
    copied = run(base / "companion", "config", "examples", "--copy", tmp_path / "drones")
    assert copied.returncode == 0, copied.stderr
    drones = sorted((tmp_path / "drones").glob("drone*.yaml"))
    assert len(drones) == 3
    checked = run(base / "companion", "check", *drones)
    assert (checked.returncode, checked.stderr) == (0, "")
    bridge = run(base / "mavlink-bridge", "betaflight", tmp_path / "none.yaml")
    assert bridge.returncode == 2
    assert len(bridge.stderr.splitlines()) == 1
    listed = run(base / "sitl-sim", "scenarios")
    assert (listed.returncode, listed.stderr) == (0, "")
    for program, arguments, extra in [
        ("sitl-sim", ["run", "forest"], "sim"),
        ("sitl-sim", ["view", tmp_path], "sim,view"),
        ("companion", ["fleet", "status", "--all", "--drones", tmp_path / "drones"], "fleet"),
    ]:
        told = run(base / program, *arguments, cwd=tmp_path)
        assert told.returncode == 2
        assert f"pip install 'swarm-companion[{extra}]'" in told.stderr
        assert len(told.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("companion dep", "deploy"),
        ("companion fleet ta", "takeoff"),
        ("sitl-sim camp", "campaign"),
        ("mavlink-bridge beta", "betaflight"),
    ],
)
def test_the_shell_completes(line, offered, tmp_path):
    program = line.split()[0]
    module = PROJECT["scripts"][program].partition(":")[0]
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    answer = tmp_path / "answer"
    environment = os.environ | asked | {"_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    code = f"import {module} as m; m.main()"
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, check=True)
    assert offered in re.split(r"[\s\x0b]+", answer.read_text())


def test_public_ci_runs_on_each_python_of_the_classifiers():
    text = (ROOT / ".github/workflows/ci.yml").read_text()
    jobs = yaml.safe_load(text)["jobs"]
    named = [c.rpartition(":: ")[2] for c in PROJECT["classifiers"] if ":: Python :: 3." in c]
    assert jobs["test"]["strategy"]["matrix"]["python"] == named
    steps = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    targets = [
        word
        for step in steps
        if step.startswith("make ")
        for word in step.split()[1:]
        if "=" not in word
    ]
    assert {"test", "reproducible", "sbom"} <= set(targets) <= MAKE_TARGETS


def test_the_container_file_is_one_whose_commands_exist():
    text = (ROOT / "Containerfile").read_text().replace("\\\n", " ")
    lines = [line.split(maxsplit=1) for line in text.splitlines() if line and line[0] != "#"]
    words = [word for word, _ in lines]
    assert words[0] == "FROM"
    assert set(words) <= {"FROM", "RUN", "COPY", "USER", "WORKDIR", "ENTRYPOINT", "CMD"}
    given = dict(lines)
    version = re.match(r"python:(3\.\d+)-slim", given["FROM"])[1]
    assert f"Programming Language :: Python :: {version}" in PROJECT["classifiers"]
    assert json.loads(given["ENTRYPOINT"])[0] in PROJECT["scripts"]
    assert given["USER"] != "root"
    runs = [shlex.split(rest) for word, rest in lines if word == "RUN"]
    (extras,) = re.findall(r"/src\[(.*?)\]", " ".join(w for r in runs for w in r))
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    for command in runs:
        for module in re.findall(r"-m (\S+)", " ".join(command)):
            assert (ROOT / f"{module.replace('.', '/')}.py").exists()


def test_the_bill_of_materials_is_valid_and_names_each_package(tmp_path):
    out = tmp_path / "sbom.json"
    options = ["--output-reproducible", "--spec-version", "1.6", "--validate"]
    made = subprocess.run(
        [
            *(sys.executable, "-m", "cyclonedx_py", "requirements", LOCKS / "eyes.txt"),
            *("--pyproject", ROOT / "pyproject.toml", *options, "--output-file", out),
        ],
        capture_output=True,
        text=True,
    )
    assert made.returncode == 0, made.stderr
    named = {c["name"] for c in json.loads(out.read_text())["components"]}
    locked = re.findall(r"^([a-z0-9-]+)==", (LOCKS / "eyes.txt").read_text(), re.MULTILINE)
    assert named == set(locked)


def test_the_page_of_statuses_names_those_of_the_code():
    page = (ROOT / "docs/exit-status.md").read_text()
    daemon, simulator = companion.commands.run, sitl_sim.commands.exit_status
    for status in (
        daemon.EXIT_UNAVAILABLE,
        daemon.EXIT_BAD_CONFIG,
        simulator.EXIT_FELL_SHORT,
        simulator.EXIT_BAD_INPUT,
        simulator.EXIT_INTERRUPTED,
    ):
        assert f"| {status} |" in page
