"""The commit that is kept with a flight is that of the flown code."""

import importlib
import re
import subprocess

import pytest

from sitl_sim import __main__ as cli
from sitl_sim.recording import code_version as codeversion


@pytest.mark.parametrize(("project", "known"), [("swarm-companion", True), ("theirs", False)])
def test_the_commit_of_another_project_is_not_taken(tmp_path, project, known):
    """An environment inside another repository holds the package, not its history."""
    installed = tmp_path / ".venv" / "lib" / "sitl_sim"
    installed.mkdir(parents=True)
    (tmp_path / "pyproject.toml").write_text(f'[project]\nname = "{project}"\n')
    author = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    for arguments in (
        ["init", "-q"],
        ["add", "pyproject.toml"],
        [*author, "commit", "-qm", "first"],
    ):
        subprocess.run(["git", *arguments], cwd=tmp_path, check=True)
    found = codeversion.commit_at(installed)
    assert bool(found and re.fullmatch(r"[0-9a-f]{7,}", found)) is known


def test_outside_a_checkout_there_is_no_commit(tmp_path):
    assert codeversion.commit_at(tmp_path) is None


def test_the_commit_is_looked_up_before_the_flight(tmp_path, monkeypatch):
    class Asked(Exception):
        pass

    def ask():
        raise Asked

    importlib.import_module("sitl_sim.flight.results")  # else it would take the stand-in for ever
    monkeypatch.setattr(codeversion, "commit", ask)
    monkeypatch.setattr(
        "sitl_sim.flight.runner.Flight.__init__", lambda *a, **k: pytest.fail("flies")
    )
    with pytest.raises(Asked):
        cli.main(["run", "crossing", "--out", str(tmp_path / "run")])
