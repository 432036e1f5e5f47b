"""Version of the code: results are kept with the commit that made them."""

from __future__ import annotations

import functools
import subprocess
import tomllib
from pathlib import Path

_PACKAGE = "swarm-companion"


@functools.cache
def commit() -> str | None:
    """Return the commit of this code, with `+` where it was changed since; None without git.

    Call it before a flight: a commit made later is not the code that this process has loaded.
    """
    return commit_at(Path(__file__).parent)


def commit_at(place: Path) -> str | None:
    """Return the commit of this package's checkout around `place`.

    None in any other checkout: an environment inside another project has none of its commits.
    """
    try:
        top = Path(_git(place, "rev-parse", "--show-toplevel"))
        project = tomllib.loads((top / "pyproject.toml").read_text("utf-8")).get("project", {})
        if project.get("name") != _PACKAGE:
            return None
        return _git(place, "describe", "--always", "--dirty=+", "--exclude=*")
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


def _git(place: Path, *arguments: str) -> str:
    said = subprocess.run(
        ["git", *arguments], cwd=place, capture_output=True, text=True, timeout=10, check=True
    )
    return said.stdout.strip()
