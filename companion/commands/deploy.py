"""`companion deploy`: install drones on their boards, or into a root directory."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.board.transport import Outcome
    from companion.settings.config import CompanionConfig
    from companion.settings.conflicts import Drone

HELP = "install or upgrade drones on their boards"
EXIT_FAILED, EXIT_BAD_INPUT = 1, 2
RESERVED = ("airframes", "bridge", "bridges", "default")  # files in each drone's folder
SSH = "ssh -o BatchMode=yes -o ConnectTimeout=10"
ARCHITECTURES = ("aarch64", "x86_64")
Drones = list[tuple[Path, "CompanionConfig"]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument(
        "config", type=Path, nargs="*", help="files of drones; default.yaml is passed over"
    )
    parser.add_argument("--root", type=Path, metavar="DIR", help="install below DIR: an image")
    parser.add_argument("--host", metavar="USER@HOST", help="default: board.host of each drone")
    parser.add_argument(
        "--remote-root",
        type=Path,
        default=Path("/"),
        metavar="DIR",
        help="install below DIR of the hosts: an image there",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the steps, and change nothing"
    )
    parser.add_argument("--rollback", action="store_true", help="back to the release before")
    parser.add_argument("--wheel", type=Path, help="default: built from this checkout")
    parser.add_argument(
        "--wheelhouse",
        type=Path,
        metavar="DIR",
        help="wheels of all dependencies, for boards without internet",
    )
    parser.add_argument(
        "--release", type=Path, metavar="FILE", help="made by --make-release; needs --signers"
    )
    parser.add_argument(
        "--signers",
        type=Path,
        metavar="FILE",
        help="whose releases you trust; a board without such a file gets it, and takes no others",
    )
    parser.add_argument(
        "--sign", type=Path, metavar="KEY", help="sign what is built here with this ssh key"
    )
    parser.add_argument(
        "--make-release", type=Path, metavar="FILE", help="make a release file, and deploy nothing"
    )
    parser.add_argument(
        "--make-wheelhouse",
        choices=ARCHITECTURES,
        help="fetch the wheels of all dependencies into --wheelhouse, and deploy nothing",
    )
    parser.add_argument(
        "--python",
        default="3.11",
        metavar="VERSION",
        help="the boards' Python, for --make-wheelhouse (3.11)",
    )
    parser.add_argument(
        "--rsh", type=_command, default=SSH, metavar="COMMAND", help=f"default: {SSH}"
    )
    parser.add_argument(
        "--allow-auto", action="store_true", help="also drones that arm and take off by themselves"
    )
    parser.add_argument("--json", action="store_true", help="for machines")


def _command(text: str) -> list[str]:
    """Return the words of a command and its options, quoted as for a shell."""
    try:
        words = shlex.split(text)
    except ValueError:
        words = []
    if not words:
        raise argparse.ArgumentTypeError(f"must be a command, its quotes closed, got {text!r}")
    return words


def run(options: argparse.Namespace) -> int:
    """Install on every board at once, and print a table of the results."""
    from companion.board.release_file import BundleError
    from mavlink_bridge.shared.settings import SettingsError

    try:
        if options.make_wheelhouse or options.make_release:
            return _make(options)
        boards = _boards(options)
        outcomes = _deploy(options, boards)
    except (SettingsError, BundleError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    rows = [
        (c.name, host or str(options.root), outcomes[host])
        for host, drones in boards.items()
        for _, c in drones
    ]
    if options.json:
        print(json.dumps([{"drone": d, "board": b, **o} for d, b, o in rows], indent=1))
    else:
        _print(rows, options.dry_run)
    return 0 if all(o["ok"] for o in outcomes.values()) else EXIT_FAILED


def _boards(options: argparse.Namespace) -> dict[str | None, Drones]:
    """Return the drones by host; None: this machine, below --root.

    Raises:
        SettingsError: a drone that must not be deployed.
    """
    from companion.settings.conflicts import bridge_problems, conflicts, read_drones
    from mavlink_bridge.shared.settings import SettingsError

    drones, problems = read_drones(options.config)
    problems += [p for drone in drones for p in _unfit(drone, options)]
    problems += [p for drone in drones for p in bridge_problems(drone)]
    problems += conflicts(drones)
    if problems or not drones:
        raise SettingsError(problems or ["no drone among these files"])
    boards: dict[str | None, Drones] = {}
    for drone in drones:
        host = options.host or (None if options.root else drone.config.board.host)
        boards.setdefault(host, []).append((drone.path, drone.config))
    return boards


def _unfit(drone: Drone, options: argparse.Namespace) -> list[str]:
    """Return why a drone is fit for a simulation and not for a board."""
    problems = []
    if drone.config.name in RESERVED:
        problems.append(
            f"{drone.place('name')}: name: {drone.config.name!r} is the name of a file "
            "or folder beside the drone's own"
        )
    if drone.config.mission.auto and not options.allow_auto:
        problems.append(
            f"{drone.place('mission.auto')}: mission.auto: the drone would arm and take "
            "off whenever its board starts; set false, or give --allow-auto"
        )
    if drone.config.mission.commission:
        problems.append(
            f"{drone.place('mission.commission')}: mission.commission: the drone would not look "
            "where it flies; set false: `companion run --commission` is for one flight"
        )
    if not (options.root or options.host or drone.config.board.host):
        problems.append(
            f"{drone.place('board.host')}: board.host: is missing; or give --host or --root"
        )
    return problems


def _deploy(
    options: argparse.Namespace, boards: dict[str | None, Drones]
) -> dict[str | None, Outcome]:
    from concurrent.futures import ThreadPoolExecutor

    from companion.board.bundle import make_bundle
    from companion.board.release_file import BundleError, unpack
    from companion.board.transport import install_here, install_over_ssh

    if options.release and not options.signers:
        raise BundleError("--release needs --signers: a file of the keys that you trust")
    flags = ["--dry-run"] * options.dry_run + ["--rollback"] * options.rollback

    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "release"
        if options.release:
            unpack(options.release, made, options.signers)
        else:
            _fill(options, made)

        def one(host: str | None) -> Outcome:
            place = Path(tempfile.mkdtemp(dir=folder))
            bundle = make_bundle(place, boards[host], made, options.signers)
            if host is None:
                return install_here(bundle, ["--root", str(options.root.resolve()), *flags])
            arguments = ["--root", str(options.remote_root), *flags]
            return install_over_ssh(bundle, arguments, host, options.rsh)

        try:
            with ThreadPoolExecutor(max_workers=16) as pool:
                return dict(zip(boards, pool.map(one, boards), strict=True))
        except KeyboardInterrupt:
            text = "a board that was being installed may go on; deploy again"
            raise KeyboardInterrupt(text) from None


def _fill(options: argparse.Namespace, folder: Path) -> None:
    """Make the release of this checkout, or of --wheel, and sign it where that is asked for."""
    from companion.board.release_file import build_wheel, fill_release, sign

    with tempfile.TemporaryDirectory() as built:
        wheel = options.wheel or build_wheel(Path(built))
        fill_release(folder, wheel, options.wheelhouse)
    if options.sign:
        sign(folder, options.sign)


def _make(options: argparse.Namespace) -> int:
    """Make a wheelhouse or a release file."""
    from companion.board.release_file import pack
    from companion.board.wheelhouse import fetch

    if options.make_wheelhouse:
        folder = options.wheelhouse or Path(f"wheels-{options.make_wheelhouse}")
        count = fetch(folder, options.make_wheelhouse, options.python)
        print(f"{folder}: {count} wheels; deploy with --wheelhouse {folder}")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        _fill(options, Path(folder))
        pack(Path(folder), options.make_release)
    signed = "signed" if options.sign else "not signed: no --sign"
    print(f"{options.make_release}: {signed}")
    return 0


def _print(rows: list[tuple[str, str, Outcome]], dry_run: bool) -> None:
    """Print the table; notes and errors below it, and of a dry run every step."""
    changed = "would change" if dry_run else "done"
    width = max(len(name) for name, _, _ in rows)
    places = max(len(board) for _, board, _ in rows)
    for name, board, outcome in rows:
        result = "failed" if not outcome["ok"] else changed if outcome["changed"] else "unchanged"
        print(f"{name:<{width}}  {board:<{places}}  {result:<12}  {outcome['seconds']:6.1f} s")
    for board, outcome in {board: outcome for _, board, outcome in rows}.items():
        for step in outcome["steps"]:
            if dry_run or step["result"] == "note":
                print(f"{board}: {step['step']}: {step['result']}: {step['detail']}")
        if not outcome["ok"]:
            print(f"{board}: {outcome['error']}; nothing was changed", file=sys.stderr)
