"""The changes of an installation: made, reported, and undone.

Like `installer.py` it runs on the board, and needs only Python itself.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path


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
    """Changes files and links, and can undo all of it."""

    def __init__(self) -> None:
        self._before: list[tuple[Path, bytes | None, int, str | None]] = []

    def write(self, path: Path, data: bytes, mode: int = 0o644) -> None:
        """Replace a file in one step."""
        self._remember(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.part")
        part.write_bytes(data)
        part.chmod(mode)
        part.replace(path)

    def link(self, path: Path, target: str) -> None:
        """Point a link elsewhere in one step."""
        self._remember(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.part")
        part.unlink(missing_ok=True)
        part.symlink_to(target)
        part.replace(path)

    def undo(self) -> None:
        """Put everything back, last first."""
        for path, data, mode, target in reversed(self._before):
            path.unlink(missing_ok=True)
            if target is not None:
                path.symlink_to(target)
            elif data is not None:
                path.write_bytes(data)
                path.chmod(mode)
        self._before.clear()

    def _remember(self, path: Path) -> None:
        target = str(path.readlink()) if path.is_symlink() else None
        there = target is None and path.exists()
        data, mode = (path.read_bytes(), path.stat().st_mode & 0o7777) if there else (None, 0)
        self._before.append((path, data, mode, target))


def run(command: list[str]) -> str:
    """Return the standard output of a command.

    Raises:
        InstallError: the command failed; with the end of its output.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", env=environment
    )
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()[-3:]
        raise InstallError(f"{Path(command[0]).name} {' '.join(command[1:4])}: {' | '.join(said)}")
    return done.stdout


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
