"""The changes of an installation: made, reported, and undone.

Like `installer.py` it runs on the board, and needs only Python itself.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import journal
from .journal import Journal


@dataclass(frozen=True)
class User:
    """A user of the board, by number."""

    uid: int
    gid: int


class InstallError(Exception):
    """The reason for which nothing was changed, or everything was put back."""


class Report:
    """The steps that were done, or would be done in a dry run."""

    def __init__(self, dry_run: bool) -> None:
        self.dry_run = dry_run
        self.steps: list[dict[str, str]] = []
        self.changed = False

    def add(self, step: str, what: str, changed: bool = True) -> bool:
        """Note a step; return whether it is to be done now."""
        word = "unchanged" if not changed else "would change" if self.dry_run else "changed"
        self.steps.append({"step": step, "result": word, "detail": what})
        self.changed |= changed
        return changed and not self.dry_run

    def note(self, step: str, what: str) -> None:
        """Note something that changes nothing."""
        self.steps.append({"step": step, "result": "note", "detail": what})


class Changes:
    """Changes files and links below `root`, and can undo all of it, even after a loss of power."""

    def __init__(self, root: Path) -> None:
        self._journal = Journal(root)

    def write(self, path: Path, data: bytes, mode: int = 0o644) -> None:
        """Replace a file in one step."""
        self._journal.record(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        journal.write(path, data, mode)

    def link(self, path: Path, target: str) -> None:
        """Point a link elsewhere in one step."""
        self._journal.record(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        journal.link(path, target)

    def undo(self) -> int:
        """Put everything back, last first; return how much that was."""
        return self._journal.put_back()

    def keep(self) -> None:
        """Let everything stay as it is now."""
        self._journal.close()


def run(command: list[str], user: User | None = None) -> str:
    """Return the standard output of a command; user: who runs it, None: this process's user.

    Raises:
        InstallError: the command failed; with the end of its output.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    rights: dict[str, Any] = {}
    if user is not None:
        environment |= {"HOME": "/nonexistent", "PIP_NO_CACHE_DIR": "1"}
        rights = {"user": user.uid, "group": user.gid, "extra_groups": []}
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", env=environment, **rights
    )
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()[-3:]
        raise InstallError(f"{Path(command[0]).name} {' '.join(command[1:4])}: {' | '.join(said)}")
    return str(done.stdout)


def link_target(link: Path, whole: bool = False) -> str | None:
    """Return the target of a link, its last part or `whole`; None where there is no link."""
    if not link.is_symlink():
        return None
    target = str(link.readlink())
    return target if whole else Path(target).name


def existing(path: Path) -> Path:
    """Return the path, or the nearest folder above it that exists."""
    return path if path.exists() else existing(path.parent)


def sha256(data: bytes) -> str:
    """Return the hash of a file's content."""
    return hashlib.sha256(data).hexdigest()
