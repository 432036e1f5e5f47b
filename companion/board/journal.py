"""The journal of a deployment: what was there before a change, on disk before the change is made.

A board that loses power in the middle comes back with the journal: what it names is put back
before any daemon starts. This file runs on the board, at boot and by itself
(`swarm-recover.service`): it needs only Python itself, and nothing beside it.

    python3 recover.py [--root /]
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HOME = "opt/swarm-companion"
JOURNAL = f"{HOME}/undo"
LOCK = f"{HOME}/.lock"


class Journal:
    """Records files and links of the tree below `root` before they change.

    It exists on disk from the first record until `close`: whatever is found there was cut short.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._folder = root / JOURNAL
        self._count = 0

    def record(self, path: Path) -> None:
        """Keep what is at `path`, or that nothing is there, on the disk itself."""
        entry: dict[str, str | int] = {"path": str(path.relative_to(self._root))}
        name = f"{self._count:05d}"
        self._folder.mkdir(parents=True, exist_ok=True)
        if path.is_symlink():
            entry["target"] = str(path.readlink())
        elif path.exists():
            entry["mode"] = path.stat().st_mode & 0o7777
            write(self._folder / f"{name}.data", path.read_bytes())
        write(self._folder / f"{name}.json", json.dumps(entry).encode())
        sync_folder(self._folder.parent)
        self._count += 1

    def close(self) -> None:
        """End the journal in one step: from here on, what was changed stays."""
        if self._folder.exists():
            ended = self._folder.with_name("undone")
            shutil.rmtree(ended, ignore_errors=True)
            self._folder.rename(ended)
            sync_folder(ended.parent)
            shutil.rmtree(ended, ignore_errors=True)
        self._count = 0

    def put_back(self) -> int:
        """Put everything back, last first, and end the journal; return how much that was.

        It may be cut short itself and done again.
        """
        entries = sorted(self._folder.glob("*.json"), reverse=True)
        for file in entries:
            entry = json.loads(file.read_text())
            path = self._root / entry["path"]
            part_of(path).unlink(missing_ok=True)
            if "target" in entry:
                link(path, entry["target"])
            elif "mode" in entry:
                if path.is_symlink():
                    path.unlink()
                write(path, file.with_suffix(".data").read_bytes(), entry["mode"])
            else:
                path.unlink(missing_ok=True)
                if path.parent.exists():
                    sync_folder(path.parent)
        self.close()
        return len(entries)


def part_of(path: Path) -> Path:
    """Return where the next content of a file is written before it takes the file's place."""
    return path.with_name(f".{path.name}.part")


def write(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Replace a file in one step: after a loss of power it is the old one or the new one."""
    part = part_of(path)
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fchmod(file.fileno(), mode)
        os.fsync(file.fileno())
    part.replace(path)
    sync_folder(path.parent)


def link(path: Path, target: str) -> None:
    """Point a link elsewhere in one step."""
    part = part_of(path)
    part.unlink(missing_ok=True)
    part.symlink_to(target)
    part.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Bring a folder's entries to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def main(arguments: list[str] | None = None) -> int:
    """Put back what a deployment left half done, unless one is under way."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--root", type=Path, default=Path("/"))
    root = parser.parse_args(arguments).root
    if not (root / JOURNAL).exists():
        return 0
    with (root / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return 0
        count = Journal(root).put_back()
    print(f"a deployment was cut short: {count} changes were put back")
    if root == Path("/"):
        with contextlib.suppress(OSError):  # no systemd
            subprocess.run(["systemctl", "daemon-reload"], check=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
