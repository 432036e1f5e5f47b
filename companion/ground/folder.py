"""The drones of a folder, as a ground station takes them."""

from __future__ import annotations

from pathlib import Path

from companion.settings.config import CompanionConfig
from companion.settings.conflicts import conflicts, read_drones
from mavlink_bridge.shared.settings import SettingsError


def read_fleet(folder: Path, key: Path | None) -> list[CompanionConfig]:
    """Return the drones of a folder; key: the file of their signing key.

    Raises:
        SettingsError: a bad file, no drone, two with one system id, or signing without a key.
    """
    drones, problems = read_drones(sorted(folder.glob("*.yaml")))
    problems += conflicts(drones)
    for d in drones:
        if (d.config.link.signing is not None) != (key is not None):
            lack = "and --signing-key is given" if key else "is set: give --signing-key FILE"
            state = "not set, " if key else ""
            problems.append(f"{d.place('link.signing')}: link.signing: {state}{lack}")
    if problems or not drones:
        raise SettingsError(problems or [f"{folder}: no drone there"])
    return [d.config for d in drones]
