"""`companion ground`: one page for the real fleet, beside QGroundControl."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

from companion.commands.deploy import SSH

if TYPE_CHECKING:
    from companion.settings.config import CompanionConfig
    from mavlink_bridge.wire.signing import Signing

HELP = "one page for the real fleet: see, arm, start, hold, resume, new goals, land, debrief"
EXIT_BAD_INPUT = 2
LINK = "udpin:0.0.0.0:14560"
SYSTEM = 254
TOKEN = "COMPANION_GROUND_TOKEN"
_LINK_ID = 2  # of signed messages; the autopilots have 0 and 1 here
Fetch = Callable[[list[str]], Awaitable[dict[str, str]]]
Show = Callable[[], str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("--drones", type=Path, default=Path("configs/drones"), metavar="DIR")
    parser.add_argument(
        "--link",
        default=LINK,
        metavar="ENDPOINT",
        help=f"where the vehicles are heard (default: {LINK}; QGroundControl keeps 14550)",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address of the page (127.0.0.1)")
    parser.add_argument("--port", type=int, default=8460, help="port of the page (8460; 0: any)")
    parser.add_argument(
        "--system-id", type=int, default=SYSTEM, metavar="N", help=f"of this station ({SYSTEM})"
    )
    parser.add_argument(
        "--signing-key", type=Path, metavar="FILE", help="of drones with link.signing"
    )
    parser.add_argument(
        "--logs", type=Path, default=Path("flights"), metavar="DIR", help="where logs are put"
    )
    parser.add_argument(
        "--rsh", type=shlex.split, default=SSH, metavar="COMMAND", help=f"default: {SSH}"
    )
    parser.add_argument(
        "--router-config",
        metavar="ADDRESS",
        help="print mavlink-router's file for the boards, to send to this ADDRESS, and end",
    )


def run(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    import asyncio

    from companion.ground.folder import read_fleet
    from companion.ground.router import router_config
    from companion.process.signing_keys import SigningKeyError
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.udp import EndpointError

    try:
        drones = read_fleet(options.drones, options.signing_key)
        if options.router_config:
            print("\n".join(router_config(d, options.router_config) for d in drones), end="")
            return 0
        asyncio.run(_serve(options, drones))
    except (SettingsError, SigningKeyError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    except EndpointError as error:
        print(f"--link {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


async def _serve(options: argparse.Namespace, drones: list[CompanionConfig]) -> None:
    """Open the link and the page, say where it is, and follow the fleet."""
    import secrets

    from companion.ground.server import LOCAL, GroundServer
    from companion.ground.station import Station, allowed
    from mavlink_bridge.wire.link import open_endpoint

    signing, advance = _signing(options.signing_key)
    endpoint = open_endpoint(options.link)
    with contextlib.closing(endpoint):
        station = Station(drones, endpoint, options.system_id, signing)
        local = options.host in LOCAL
        token = os.environ.get(TOKEN, "") or ("" if local else secrets.token_urlsafe(16))
        server = GroundServer(station, token, *_log_keeper(options, drones), advance)
        deaf = [d.name for d in drones if not allowed(d, options.system_id)]
        if deaf:
            server.notes.append(
                f"resume and goals need link.allow: [[{options.system_id}, 190]] in the files of "
                + ", ".join(deaf)
            )
        port = server.listen(options.host, options.port)
        host = f"[{options.host}]" if ":" in options.host else options.host
        print(f"vehicles at {options.link}, system id {options.system_id}")
        print(f"page at http://{host}:{port}/" + (f"?token={token}" if token else ""), flush=True)
        await server.run()


def _signing(key: Path | None) -> tuple[Signing | None, Callable[[float], None]]:
    """Return the key of the fleet, and what keeps its time.

    Raises:
        SigningKeyError: the key cannot be used.
    """
    if key is None:
        return None, lambda now: None
    from companion.process.signing_keys import open_signing

    timestamps = open_signing("ground", str(key), _LINK_ID)
    return timestamps.signing, timestamps.tick


def _log_keeper(options: argparse.Namespace, drones: list[CompanionConfig]) -> tuple[Fetch, Show]:
    """Return what pulls logs of drones, and what shows the debriefing of those pulled."""
    import asyncio

    from companion.board.logs import pull
    from companion.debrief.page import page
    from companion.debrief.swarm import debrief

    pulled: dict[str, Path] = {}

    def one(name: str) -> str:
        config = next(d for d in drones if d.name == name)
        outcome = pull(config, options.logs, options.rsh)
        if outcome.newest is None:
            return outcome.problem
        pulled[name] = outcome.newest
        return f"{outcome.count} new, newest {outcome.newest.name}"

    async def fetch(names: list[str]) -> dict[str, str]:
        told = await asyncio.gather(*(asyncio.to_thread(one, n) for n in names))
        return dict(zip(names, told, strict=True))

    return fetch, lambda: page(debrief(sorted(pulled.values())))
