"""The bundle for one board: a release, and the files of its drones."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from companion.board.release_file import UNITS, BundleError, copy, release_name
from companion.settings.config import CompanionConfig, bridge_of, layers_of


def make_bundle(
    folder: Path,
    drones: Sequence[tuple[Path, CompanionConfig]],
    release: Path,
    signers: Path | None = None,
) -> Path:
    """Fill `folder` as `installer.py` expects it, and return it.

    drones: each drone's file and configuration. release: a folder as `fill_release` makes it.
    signers: whose releases alone the board is to take from now on.

    Raises:
        BundleError: a calibration or model outside the drone's folder.
    """
    shutil.copytree(release, folder, dirs_exist_ok=True)
    if signers is not None:
        copy(signers, folder / "signers")
    for path, config in drones:
        _put_drone(folder, path, config)
    eyes = any(config.sensing.uses_network for _, config in drones)
    lock = "eyes.txt" if eyes else "base.txt"
    plan = {
        "release": release_name(next((folder / "wheel").iterdir())) + ("-eyes" if eyes else ""),
        "lock": lock,
        "drones": [{"name": c.name, "units": _units_of(p)} for p, c in drones],
    }
    (folder / "plan.json").write_text(json.dumps(plan, indent=1))
    return folder


def _units_of(path: Path) -> list[str]:
    """Return the units of a drone, the bridge first: the companion listens to it."""
    bridge = ["mavlink-bridge@.service"] if bridge_of(path).exists() else []
    return [*bridge, "companion@.service"]


def _put_drone(folder: Path, path: Path, config: CompanionConfig) -> None:
    """Put a drone's file, layers, calibration and model into a folder for /etc."""
    home = folder / "config" / config.name
    copy(path, home / f"{config.name}.yaml")
    if bridge_of(path).exists():
        copy(bridge_of(path), home / "bridge.yaml")
    needed = layers_of(path)
    needed += [Path(f) for f in (config.camera.calibration, config.sensing.model) if f]
    for file in needed:
        if not file.resolve().is_relative_to(path.parent.resolve()):
            raise BundleError(f"{file}: must lie beside {path} to be shipped with it")
        copy(file, home / file.resolve().relative_to(path.parent.resolve()))
    drop_in = folder / "owned" / UNITS / f"companion@{config.name}.service.d" / "board.conf"
    drop_in.parent.mkdir(parents=True)
    pinned = f"[Service]\nCPUAffinity={config.board.cpus}\n" if config.board.cpus else ""
    drop_in.write_text(f"# From {config.name}.yaml, written by `companion deploy`.\n{pinned}")
