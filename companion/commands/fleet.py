"""`companion fleet`: actions on the vehicles of a folder of drones, from a ground station."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.ground.row import Row
    from companion.settings.conflicts import Drone

HELP = "arm, take off, start, hold or land many vehicles at once"
EXIT_FAILED, EXIT_BAD_INPUT = 1, 2
ACTIONS = {
    "arm": "arm",
    "takeoff": "climb to mission.takeoff_altitude and hold there",
    "start": "hand over to the companions (offboard); they must be running",
    "hold": "stop and stay; the companions give control up",
    "land": "land where they are",
    "status": "show their state",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument(
        "action", choices=ACTIONS, help="; ".join(f"{a}: {h}" for a, h in ACTIONS.items())
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--all", action="store_true", help="every drone of the folder")
    which.add_argument("--only", nargs="+", metavar="NAME", help="these drones")
    parser.add_argument("--drones", type=Path, default=Path("configs/drones"), metavar="DIR")
    parser.add_argument(
        "--url",
        default="udpin://0.0.0.0:14550",
        help="endpoint at which ground stations hear the vehicles",
    )
    parser.add_argument(
        "--patience", type=float, default=5.0, metavar="S", help="time for the vehicles to appear"
    )
    parser.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="of drones with link.signing, where it is not the file that they name",
    )
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Act on all vehicles at once, and print a table; 1 where one did not do it."""
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.udp import EndpointError

    try:
        drones = _drones(options.drones, None if options.all else options.only)
        rows = _acted(options, drones)
    except SettingsError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    except EndpointError as error:
        print(f"--url {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if options.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    else:
        _print(rows)
    return 0 if all(row.ok for row in rows) else EXIT_FAILED


def _acted(options: argparse.Namespace, drones: list[Drone]) -> list[Row]:
    """Act on the vehicles by MAVSDK; by the ground station's own line where they sign.

    Raises:
        SettingsError: a signing key cannot be used.
        EndpointError: the URL cannot be opened.
    """
    import asyncio

    from companion.ground.signed_fleet import act_signed, key_of

    configs, key = [d.config for d in drones], key_of(drones, options.signing_key)
    if key is not None:
        return act_signed(options.action, configs, key, options.url, options.patience)
    from companion.ground.fleet import act

    return asyncio.run(act(options.action, configs, options.url, options.patience))


def _drones(folder: Path, names: list[str] | None) -> list[Drone]:
    """Return the drones of a folder, all or those named.

    Raises:
        SettingsError: a bad file, an unknown name, or two drones with one system id.
    """
    from companion.settings.conflicts import conflicts, read_drones
    from mavlink_bridge.shared.settings import SettingsError

    drones, problems = read_drones(sorted(folder.glob("*.yaml")))
    problems += conflicts(drones)
    known = {d.config.name: d for d in drones}
    for name in names or []:
        if name not in known:
            problems.append(f"{folder}: no drone {name!r}; valid: {', '.join(known)}")
    if problems or not drones:
        raise SettingsError(problems or [f"{folder}: no drone there"])
    return [known[n] for n in (names if names is not None else known)]


def _print(rows: list[Row]) -> None:
    """Print the table of states."""
    width = max(5, *(len(row.drone) for row in rows))
    print(f"{'drone':<{width}}  system  armed  {'mode':<10}  height  battery  result")
    for row in rows:
        armed = {True: "yes", False: "no", None: "-"}[row.armed]
        height = "-" if row.height is None else f"{row.height:.1f} m"
        battery = "-" if row.battery_percent is None else f"{row.battery_percent:.0f} %"
        print(
            f"{row.drone:<{width}}  {row.system:>6}  {armed:<5}  {row.mode or '-':<10}  "
            f"{height:>6}  {battery:>7}  {row.result}"
        )
