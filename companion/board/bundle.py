"""The bundle for one board: a wheel, units, and the files of its drones."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import companion
from companion.board import installer
from companion.settings.config import CompanionConfig, bridge_of, layers_of
from companion.settings.packaged import data_folder

UNITS = "etc/systemd/system"
RULES = "etc/udev/rules.d"
_WHEEL_PARTS = 5  # at least; a build number is one more
_INSTALLER = ("__init__.py", "changes.py", "installer.py", "release.py", "services.py")
# `python3 BUNDLE` is the installer.
_MAIN = "import sys\n\nfrom board.installer import main\n\nsys.exit(main())\n"
# By its real path: a running daemon must not see an upgrade.
_LAUNCHER = """#!/bin/sh
home=$(dirname "$(readlink -f "$0")")
exec "$(readlink -f "$home/current")/bin/python" -I -m {module} "$@"
"""


class BundleError(ValueError):
    """A file that cannot be shipped; the message says why."""


def build_wheel(folder: Path) -> Path:
    """Return the wheel of the checkout that this code runs from.

    Raises:
        BundleError: there is no checkout, or its wheel does not build.
    """
    checkout = Path(companion.__file__).parents[1]
    if not (checkout / "pyproject.toml").exists():
        raise BundleError("not run from a checkout: name the wheel to install with --wheel")
    options = ["--quiet", "--no-deps", "--wheel-dir", str(folder)]
    command = [sys.executable, "-m", "pip", "wheel", *options, str(checkout)]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode:
        raise BundleError(f"the wheel does not build: {built.stderr.strip()[-500:]}")
    return next(folder.glob("*.whl"))


def release_name(wheel: Path) -> str:
    """Return version and hash of a wheel: the same wheel is the same release.

    Raises:
        BundleError: there is no such file, or its name is not that of a wheel.
    """
    parts = wheel.name.split("-")
    if wheel.suffix != ".whl" or len(parts) < _WHEEL_PARTS:
        raise BundleError(
            f"--wheel {wheel}: must be named as a wheel, NAME-VERSION-PYTHON-ABI-PLATFORM.whl"
        )
    try:
        content = wheel.read_bytes()
    except OSError as error:
        raise BundleError(f"--wheel {wheel}: cannot be read: {error.strerror}") from error
    return f"{parts[1]}-{hashlib.sha256(content).hexdigest()[:10]}"


def make_bundle(
    folder: Path,
    drones: Sequence[tuple[Path, CompanionConfig]],
    wheel: Path,
    wheelhouse: Path | None = None,
) -> Path:
    """Fill `folder` as `installer.py` expects it, and return it.

    drones: each drone's file and configuration. wheelhouse: wheels of all dependencies, for a board
    without internet.

    Raises:
        BundleError: no such wheel, or a calibration or model outside the drone's folder.
    """
    release = release_name(wheel)
    for name in _INSTALLER:
        _copy(Path(installer.__file__).with_name(name), folder / "board" / name)
    (folder / "__main__.py").write_text(_MAIN)
    _copy(wheel, folder / "wheel" / wheel.name)
    if wheelhouse is not None:
        shutil.copytree(wheelhouse, folder / "wheelhouse")
    _put_units(folder / "owned")
    for path, config in drones:
        _put_drone(folder, path, config)
    plan = {
        "release": release,
        "drones": [{"name": c.name, "units": _units_of(p)} for p, c in drones],
    }
    (folder / "plan.json").write_text(json.dumps(plan, indent=1))
    return folder


def _units_of(path: Path) -> list[str]:
    """Return the units of a drone, the bridge first: the companion listens to it."""
    bridge = ["mavlink-bridge@.service"] if bridge_of(path).exists() else []
    return [*bridge, "companion@.service"]


def _put_units(owned: Path) -> None:
    for source in sorted(data_folder("systemd").iterdir()):
        place = RULES if source.suffix == ".rules" else UNITS
        _copy(source, owned / place / source.name)
    for name, module in (("companion", "companion"), ("mavlink-bridge", "mavlink_bridge")):
        launcher = owned / installer.HOME / name
        launcher.parent.mkdir(parents=True, exist_ok=True)
        launcher.write_text(_LAUNCHER.format(module=module))
        launcher.chmod(0o755)


def _put_drone(folder: Path, path: Path, config: CompanionConfig) -> None:
    """Put a drone's file, layers, calibration and model into a folder for /etc."""
    home = folder / "config" / config.name
    _copy(path, home / f"{config.name}.yaml")
    if bridge_of(path).exists():
        _copy(bridge_of(path), home / "bridge.yaml")
    needed = layers_of(path)
    needed += [Path(f) for f in (config.camera.calibration, config.sensing.model) if f]
    for file in needed:
        if not file.resolve().is_relative_to(path.parent.resolve()):
            raise BundleError(f"{file}: must lie beside {path} to be shipped with it")
        _copy(file, home / file.resolve().relative_to(path.parent.resolve()))
    drop_in = folder / "owned" / UNITS / f"companion@{config.name}.service.d" / "board.conf"
    drop_in.parent.mkdir(parents=True)
    pinned = f"[Service]\nCPUAffinity={config.board.cpus}\n" if config.board.cpus else ""
    drop_in.write_text(f"# From {config.name}.yaml, written by `companion deploy`.\n{pinned}")


def _copy(source: Path, to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, to)
