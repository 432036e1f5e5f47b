"""What boards install: locked by hash, for each machine; and who installs it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from companion.board.account import installing_user
from companion.board.changes import Report, User
from companion.board.prune import prune
from companion.board.release import make_release
from companion.board.wheelhouse import LOCKS
from tests.companion.deployment import small_wheel

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]


def locked(name):
    """Return the versions that a lock file names for each package."""
    versions = {}
    for line in (LOCKS / name).read_text().splitlines():
        if not line.startswith(" "):
            package, _, version = line.split(" ")[0].partition("==")
            versions.setdefault(canonicalize_name(package), []).append(version)
    return versions


@pytest.mark.parametrize("name", ["base", "eyes"])
def test_the_lock_is_that_of_the_project(name):
    """`make lock` after a change of the dependencies."""
    wanted = PROJECT["dependencies"] + PROJECT["optional-dependencies"].get(name, [])
    versions = locked(f"{name}.txt")
    for requirement in map(Requirement, wanted):
        found = versions[canonicalize_name(requirement.name)]
        assert all(requirement.specifier.contains(v) for v in found), requirement


@pytest.mark.parametrize("name", ["base", "eyes"])
def test_each_package_has_hashes_and_no_host_is_named(name):
    text = (LOCKS / f"{name}.txt").read_text()
    for block in re.split(r"\n(?=\S)", text.strip()):
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", block), block[:60]
    assert "://" not in text


def bundle_of(folder, lock=""):
    wheel = small_wheel(folder / "wheel", "1.0")
    (folder / "locks").mkdir()
    (folder / "locks/base.txt").write_text(lock)
    return wheel.parent.parent


def test_another_wheel_than_the_locked_one_is_not_installed(tmp_path):
    house = tmp_path / "wheelhouse"
    small_wheel(house, "9.9").rename(house / "numpy-9.9-py3-none-any.whl")
    bundle = bundle_of(tmp_path, f"numpy==9.9 --hash=sha256:{'0' * 64}\n")
    release = tmp_path / "release"
    with pytest.raises(Exception, match=r"Expected sha256 0{64}"):
        make_release(release, bundle, bundle / "locks/base.txt", tmp_path / "none", Report(False))


PYTHON = "/usr/bin/python3"  # as on a board: a user's own may lie where others cannot read


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
@pytest.mark.skipif(not Path(PYTHON).exists(), reason=f"{PYTHON} is missing (Debian: python3-venv)")
def test_root_runs_nothing_that_a_package_brings(monkeypatch):
    """pip and the release's programs run as an account without rights; root owns the result."""
    monkeypatch.setattr(sys, "executable", PYTHON)
    ran = []
    run = subprocess.run
    monkeypatch.setattr(
        "companion.board.changes.subprocess.run",
        lambda command, **more: ran.append((more["user"], more["group"])) or run(command, **more),
    )
    with tempfile.TemporaryDirectory() as folder:
        top = Path(folder)
        top.chmod(0o755)
        bundle = bundle_of(top)
        release = top / "release"
        nobody = User(65534, 65534)
        lock = bundle / "locks/base.txt"
        make_release(release, bundle, lock, top / "none", Report(False), nobody)
        assert {p.lstat().st_uid for p in [release, *release.rglob("*")]} == {0}
        (top / "current").symlink_to("release")
        make_release(top / "next", bundle, lock, top / "current", Report(False), nobody)
        assert {p.lstat().st_uid for p in (top / "next").rglob("*")} == {0}
    assert len(ran) >= 4
    assert set(ran) == {(65534, 65534)}


def test_an_image_is_made_by_whoever_makes_it(tmp_path):
    assert installing_user(tmp_path, tmp_path, dry_run=False) is None


def environment_with_casadi(folder, needs):
    """Make an environment with a small CasADi, whose self-test maps one library."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    packages = next(folder.glob("lib/python3*/site-packages"))
    casadi = packages / "casadi"
    for name in ("__init__.py", "libused.so", "libunused.so", "include/a.hpp", "LICENSE/b.txt"):
        (casadi / name).parent.mkdir(parents=True, exist_ok=True)
        (casadi / name).write_text("x" * 1000)
    test = packages / "companion/board/self_test.py"
    test.parent.mkdir(parents=True)
    test.write_text(
        "import pathlib, sys\n"
        f"casadi = pathlib.Path({str(casadi)!r})\n"
        f"assert (casadi / {needs!r}).exists(), 'it is needed'\n"
        "print(casadi / 'libused.so')\n"
    )
    return casadi


def test_what_the_self_test_loads_stays(tmp_path):
    casadi = environment_with_casadi(tmp_path / "release", "libused.so")
    assert prune(tmp_path / "release") == 2000
    left = {str(p.relative_to(casadi)) for p in casadi.rglob("*") if p.is_file()}
    assert left == {"__init__.py", "libused.so", "LICENSE/b.txt"}
    assert prune(tmp_path / "release") == 0


def test_a_release_that_pruning_breaks_is_refused(tmp_path):
    environment_with_casadi(tmp_path / "release", "include/a.hpp")
    with pytest.raises(Exception, match="it is needed"):
        prune(tmp_path / "release")


@pytest.mark.parametrize("python", ["3", "3.1", "three"])
def test_a_wheelhouse_for_no_python_is_refused(python, tmp_path, capsys):
    from companion.__main__ import main

    command = ["deploy", "--make-wheelhouse", "aarch64", "--python", python]
    assert main([*command, "--wheelhouse", str(tmp_path)]) == 2
    assert "must be a version as 3.11" in capsys.readouterr().err


def test_a_wheelhouse_is_asked_for_by_hash_for_the_boards_machine(tmp_path, monkeypatch, capsys):
    """pip itself is a stand-in: the packages of another machine are 120 MB."""
    from companion.__main__ import main

    asked = []

    def run(command, **_):
        asked.append(command)
        (tmp_path / "wheels").mkdir()
        (tmp_path / "wheels/a.whl").touch()
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr("companion.board.wheelhouse.subprocess.run", run)
    command = ["deploy", "--make-wheelhouse", "aarch64", "--python", "3.13"]
    assert main([*command, "--wheelhouse", str(tmp_path / "wheels")]) == 0
    assert "1 wheels" in capsys.readouterr().out
    (told,) = asked
    assert {"--require-hashes", "--only-binary", "3.13", "manylinux_2_28_aarch64"} <= set(told)
    assert not any("x86_64" in word for word in told)
    assert shutil.which(told[0]) or Path(told[0]).exists()
