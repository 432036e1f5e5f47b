"""A release on a board: a virtual environment of its own, tried before it is used.

Like `installer.py` it runs on the board, and needs only Python itself.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from pathlib import Path

from .changes import InstallError, existing, run

_SPACE = 1_000_000_000  # bytes that a release and its download need


def make_release(release: Path, bundle: Path, current: Path) -> None:
    """Make the environment `release` and install the bundle's wheel in it.

    current: the release in use, if any.

    Raises:
        InstallError: no space, or pip failed.
    """
    _make_environment(release, current)
    python = str(release / "bin/python")
    run([python, *_pip(bundle), "--force-reinstall", "--no-deps"])
    run([python, *_pip(bundle)])  # the dependencies that are not there yet


def check_configurations(release: Path, files: list[Path]) -> None:
    """Let the release check the configurations that it is to run.

    Raises:
        InstallError: it refuses one, or two drones claim the same thing.
    """
    python = str(release / "bin/python")
    run([python, "-I", "-m", "companion", "check", *map(str, files)])


def _make_environment(release: Path, current: Path) -> None:
    """Make an environment with the packages of the current release, hard-linked where possible.

    Links cost neither time nor space. pip never writes into a linked file: it unlinks it first.
    """
    before = list(current.glob("lib/python3*/site-packages"))
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    if len(before) == 1 and before[0].parent.name == version:
        run([sys.executable, "-m", "venv", "--without-pip", str(release)])
        packages = release / "lib" / version / "site-packages"
        with contextlib.suppress(OSError):  # a file system without links: an empty one instead
            shutil.copytree(before[0], packages, copy_function=os.link, dirs_exist_ok=True)
            return
        shutil.rmtree(release)
    free = shutil.disk_usage(existing(release.parent)).free
    if free < _SPACE:
        raise InstallError(f"{free / 1e6:.0f} MB free, {_SPACE / 1e6:.0f} MB needed")
    run([sys.executable, "-m", "venv", str(release)])


def _pip(bundle: Path) -> list[str]:
    """Return the arguments that install the wheel, offline where the bundle has a wheelhouse."""
    wheels = [str(p) for p in sorted((bundle / "wheel").glob("*.whl"))]
    house = bundle / "wheelhouse"
    source = ["--no-index", "--find-links", str(house)] if house.exists() else []
    options = ["--quiet", "--disable-pip-version-check", "--no-input"]
    return ["-m", "pip", "install", *options, *source, *wheels]
