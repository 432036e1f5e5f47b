"""A release on a board: a virtual environment of its own, tried before it is used.

Like `installer.py` it runs on the board, and needs only Python itself. As root it lets an account
without rights do everything that runs code of packages; root owns the result.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from pathlib import Path

from .changes import InstallError, Report, User, existing, run
from .prune import prune

_SPACE = 900_000_000  # bytes that a release and its download need at most


def make_release(
    release: Path,
    bundle: Path,
    lock: Path,
    current: Path,
    report: Report,
    user: User | None = None,
) -> None:
    """Make the environment `release`, install the bundle's wheel in it, and prune it.

    lock: its dependencies, with hashes. current: the release in use, if any. user: who runs pip;
    None: this process's user.

    Raises:
        InstallError: no space, pip failed, or the pruned release does not work.
    """
    linked = _make_environment(release, current, user)
    try:
        _fill(release, bundle, lock, report, user)
    except InstallError:
        if not linked:
            raise
        # Something that the release before was pruned of may be needed now.
        shutil.rmtree(release)
        _make_environment(release, None, user)
        _fill(release, bundle, lock, report, user)
    if user is not None:
        _give(release, User(0, 0))


def check_configurations(release: Path, files: list[Path], user: User | None = None) -> None:
    """Let the release check the configurations that it is to run.

    Raises:
        InstallError: it refuses one, or two drones claim the same thing.
    """
    python = str(release / "bin/python")
    run([python, "-I", "-m", "companion", "check", *map(str, files)], user)


def _make_environment(release: Path, current: Path | None, user: User | None) -> bool:
    """Make an environment with the packages of the current release, hard-linked where possible.

    Links cost neither time nor space. pip never writes into a linked file: it unlinks it first.
    Return whether it holds packages already.
    """
    release.mkdir(parents=True)
    if user is not None:
        os.chown(release, user.uid, user.gid)
    before = list(current.glob("lib/python3*/site-packages")) if current else []
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    if len(before) == 1 and before[0].parent.name == version:
        run([sys.executable, "-m", "venv", "--without-pip", str(release)], user)
        packages = release / "lib" / version / "site-packages"
        with contextlib.suppress(OSError):  # a file system without links: an empty one instead
            shutil.copytree(before[0], packages, copy_function=os.link, dirs_exist_ok=True)
            if user is not None:
                _give(packages, user, folders_only=True)
            return True
        shutil.rmtree(release)
        return _make_environment(release, None, user)
    free = shutil.disk_usage(existing(release.parent)).free
    if free < _SPACE:
        raise InstallError(f"{free / 1e6:.0f} MB free, {_SPACE / 1e6:.0f} MB needed")
    run([sys.executable, "-m", "venv", str(release)], user)
    return False


def _fill(release: Path, bundle: Path, lock: Path, report: Report, user: User | None) -> None:
    """Install what the lock file names, by hash, and the wheel, which the bundle's sums name."""
    pip = [str(release / "bin/python"), "-m", "pip", "install"]
    pip += ["--quiet", "--disable-pip-version-check", "--no-input", "--only-binary", ":all:"]
    house = bundle / "wheelhouse"
    source = ["--no-index", "--find-links", str(house)] if house.exists() else []
    if lock.stat().st_size:
        run([*pip, *source, "--no-deps", "--require-hashes", "--requirement", str(lock)], user)
    wheel = str(next((bundle / "wheel").glob("*.whl")))
    run([*pip, "--no-index", "--no-deps", "--force-reinstall", wheel], user)
    freed = prune(release, user)
    if freed:
        report.note("prune", f"{freed / 1e6:.0f} MB of CasADi that no flight loads")


def _give(folder: Path, user: User, folders_only: bool = False) -> None:
    """Give a tree to a user; no link is followed."""
    os.chown(folder, user.uid, user.gid, follow_symlinks=False)
    for path, folders, files in os.walk(folder):
        for name in folders if folders_only else [*folders, *files]:
            os.chown(Path(path) / name, user.uid, user.gid, follow_symlinks=False)
