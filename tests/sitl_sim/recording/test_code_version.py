"""The commit that is kept with a flight is that of the code that flew."""

import re
import subprocess

import pytest

from sitl_sim import __main__ as cli
from sitl_sim.recording import code_version as codeversion


@pytest.mark.parametrize(("project", "known"), [("swarm-companion", True), ("theirs", False)])
def test_another_projects_commit_is_not_ours(tmp_path, project, known):
    """An environment inside somebody's repository holds the package, not its history."""
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


def test_without_a_project_there_is_none(tmp_path):
    assert codeversion.commit_at(tmp_path) is None


def test_it_is_asked_for_before_anything_flies(tmp_path, monkeypatch):
    class Asked(Exception):
        pass

    def ask():
        raise Asked

    monkeypatch.setattr(codeversion, "commit", ask)
    monkeypatch.setattr(
        "sitl_sim.flight.runner.Flight.__init__", lambda *a, **k: pytest.fail("flies")
    )
    with pytest.raises(Asked):
        cli.main(["run", "crossing", "--out", str(tmp_path / "run")])
