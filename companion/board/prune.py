"""Prunes a release of the files of CasADi that nothing loads.

CasADi's wheel brings headers, programs, and some sixty solvers, many of them three times. What
stays is Python, licences, and each library that the release's self-test maps into memory; the
self-test then runs once more. Like `installer.py` this runs on the board, and needs only Python
itself.

    python3 -m companion.board.prune RELEASE    # any virtual environment
"""

from __future__ import annotations

import sys
from pathlib import Path

from .changes import InstallError, User, run

_KEPT = {".py", ".pyc", ".typed"}


def prune(release: Path, user: User | None = None) -> int:
    """Prune the virtual environment; return the bytes freed.

    user: who runs the self-test; None: this process's user.

    Raises:
        InstallError: the self-test fails.
    """
    folder = next(iter(release.glob("lib/python3*/site-packages/casadi")), None)
    if folder is None:
        return 0
    loaded = _self_test(release, user)
    freed = 0
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            if not any(path.iterdir()):
                path.rmdir()
        elif not (path.suffix in _KEPT or "LICENSE" in str(path) or path.resolve() in loaded):
            freed += path.lstat().st_size
            path.unlink()
    if freed:
        _self_test(release, user)
    return freed


def _self_test(release: Path, user: User | None) -> set[Path]:
    """Return the libraries that the release's self-test loads.

    Raises:
        InstallError: it fails.
    """
    command = [str(release / "bin/python"), "-I", "-m", "companion.board.self_test"]
    return {Path(line).resolve() for line in run(command, user).splitlines()}


if __name__ == "__main__":
    try:
        print(f"{prune(Path(sys.argv[1])) / 1e6:.0f} MB freed")
    except (IndexError, InstallError) as error:
        sys.exit(f"usage: python3 -m companion.board.prune RELEASE: {error}")
