"""The inputs of a flight, written into its run folder before the flight begins."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.recording.run_folder import holds_flight
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import KEY_FILE
from sitl_sim.scenarios.scenario import Scenario


def write_inputs(
    folder: Path,
    scenario: Scenario,
    world: Mapping[str, Any],
    companions: Mapping[str, Any],
    key: bytes | None = None,
) -> None:
    """Write the resolved scenario, the world, and each companion's config by drone name.

    key: with which the companions sign.

    Raises:
        SettingsError: the folder holds a flight, or cannot be created.
    """
    if holds_flight(folder):
        raise SettingsError([f"{folder}: holds a flight; name another folder"])
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError([f"{folder}: no run folder: {error.strerror}"]) from error
    text = yaml.safe_dump(scenario.model_dump(by_alias=True), sort_keys=False)
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    write_world(folder, world)
    for name, config in companions.items():
        drone = folder / "drones" / name
        drone.mkdir(parents=True, exist_ok=True)
        text = yaml.safe_dump(config, sort_keys=False)
        (drone / "config.yaml").write_text(text, encoding="utf-8")
        if key is not None:
            _write_key(drone / KEY_FILE, key)


def whose_targets(scenario: Scenario, start: Vector) -> dict[str, Any]:
    """Return the targets of our drones and the names of the others, as `world.json` has them.

    start: (n,3) m, world.
    """
    foreign = scenarios.foreign_names(scenario)
    targets = placement.targets(scenario, start)
    ours = {name: goals for name, goals in targets.items() if name not in foreign}
    return {"targets": ours} | ({"foreign": foreign} if foreign else {})


def _write_key(path: Path, key: bytes) -> None:
    """Write a signing key that only its owner can read: a companion refuses any other."""
    path.touch(0o600)
    path.write_text(key.hex() + "\n", encoding="ascii")


def write_world(folder: Path, world: Mapping[str, Any]) -> None:
    """Write `world.json`."""
    world = {**world}  # where sizes differ, the file has them by name
    world["drone_radius"] = world.pop("drone_radii", world["drone_radius"])
    (folder / "world.json").write_text(json.dumps(world, indent=1), encoding="utf-8")
