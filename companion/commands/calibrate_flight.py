"""`companion calibrate FLIGHT.mcap`: the findings as a table, and the drone's file with them."""

from __future__ import annotations

import difflib
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.commissioning.findings import Finding
    from companion.commissioning.flight import CommissioningFlight
    from companion.settings.edit import Value

_REFUSED, _BAD_INPUT = 1, 2


def from_flight(log: Path, write: Path | None, *, machine: bool) -> int:
    """Print what the flight tells, and change the drone's file `write`; return the exit status.

    machine: JSON instead of a table.
    """
    from companion.commissioning.findings import changes, find
    from companion.commissioning.flight import read_flight
    from mavlink_bridge.shared.mcap_file import LogError
    from mavlink_bridge.shared.settings import SettingsError

    try:
        flight = read_flight(log)
        findings = find(flight)
        wanted = changes(flight, findings)
        lens = _lens(flight, findings, write)
        if lens is not None:
            wanted["camera", "calibration"] = lens
        difference = "" if write is None or not wanted else _write(write, wanted)
    except (LogError, SettingsError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return _BAD_INPUT
    status = 0 if all(f.told for f in findings) else _REFUSED
    if machine:
        print(json.dumps(_as_data(findings, wanted), indent=1))
        return status
    for f in findings:
        print(_line(f))
    print()
    print(_told(wanted, write, difference), end="")
    return status


def _lens(flight: CommissioningFlight, findings: list[Finding], write: Path | None) -> str | None:
    """Write the calibration with its new focal length beside the drone's file; return its name.

    None where there is none to write.
    """
    focal = next(f for f in findings if f.name == "focal scale")
    if flight.config.camera.calibration is None or not focal.told or write is None:
        return None
    name = f"{write.stem}-camera.yaml"
    camera = flight.camera
    replace(camera, fx=camera.fx * focal.value, fy=camera.fy * focal.value).save(
        write.with_name(name)
    )
    return name


def _write(path: Path, wanted: Mapping[tuple[str, str], Value]) -> str:
    """Change the drone's file, if it is still valid then; return the difference.

    A Betaflight's bridge passes thrust on as throttle: its file gets the hover thrust, too.

    Raises:
        SettingsError: the file has mistakes, before or after.
    """
    from companion.settings.config import bridge_of, load_config
    from companion.settings.edit import edited

    load_config(path)
    changes = {path: dict(wanted)}
    hover, bridge = wanted.get(("airframe", "hover_thrust")), bridge_of(path)
    if hover is not None and bridge.exists():
        changes[bridge] = {("throttle", "hover"): hover}
    before = {file: file.read_text(encoding="utf-8") for file in changes}
    after = {file: edited(before[file], changes[file]) for file in changes}
    difference: list[str] = []
    try:
        for file, text in after.items():
            file.write_text(text, encoding="utf-8")
            old, new = (t.splitlines(keepends=True) for t in (before[file], text))
            difference += difflib.unified_diff(old, new, str(file), str(file), n=0)
        load_config(path)
    except BaseException:
        for file, text in before.items():
            file.write_text(text, encoding="utf-8")
        raise
    return "".join(difference)


def _told(wanted: Mapping[tuple[str, str], Value], write: Path | None, difference: str) -> str:
    from companion.settings.edit import as_block

    if not wanted:
        return "nothing to configure\n"
    if write is None:
        return as_block(wanted)
    return difference or f"{write}: says so already\n"


def _line(f: Finding) -> str:
    if f.told:
        return f"{f.name:14} {_number(f):>16} {f.unit}".rstrip()
    return f"{f.name:14} {'refused':>16} {f.refusal}"


def _number(f: Finding) -> str:
    digits = 2 if f.unit == "°" else 4
    return f"{f.value:.{digits}f} ± {f.sigma:.{digits}f}"


def _as_data(findings: list[Finding], wanted: Mapping[tuple[str, str], Value]) -> dict[str, object]:
    configuration: dict[str, dict[str, Value]] = {}
    for (section, key), value in wanted.items():
        configuration.setdefault(section, {})[key] = value
    return {
        "findings": {
            f.name: {"value": f.value, "sigma": f.sigma, "unit": f.unit}
            if f.told
            else {"refused": f.refusal}
            for f in findings
        },
        "configuration": configuration,
    }
