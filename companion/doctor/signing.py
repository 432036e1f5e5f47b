"""Whether the autopilot obeys commands that are not signed."""

from __future__ import annotations

import os
import time

from companion.doctor.finding import Finding, Level
from companion.process.signing_keys import SigningKeyError, find_key, open_signing
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, parse_endpoint
from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    Command,
    CommandAck,
    CommandId,
    ParamValue,
    Source,
)

ANSWERS = (AutopilotVersion, CommandAck, ParamValue)  # which nothing but a request brings about
_ATTEMPTS, _WAIT = 6, 0.5  # times that the vehicle is asked, and s between them
_VERSION = 148.0
_SETUP = "give the autopilot the key: SETUP_SIGNING (Mission Planner, MAVProxy `signing setup`)"


def examine_unsigned(config: CompanionConfig, link: Link) -> Finding:
    """Ask the vehicle, unsigned, for its version, and examine whether it answers.

    A vehicle that checks signatures sees no command in it.
    """
    system = config.link.system_id
    for _ in range(_ATTEMPTS):
        link.send([Command(CommandId.REQUEST_MESSAGE, (_VERSION, 0, 0, 0, 0, 0, 0), system)])
        deadline = time.monotonic() + _WAIT
        while (left := deadline - time.monotonic()) > 0.0:
            link.wait(min(left, 0.05))
            heard = [r for r in link.receive() if r.source == Source(system, 1)]
            if any(isinstance(r.message, ANSWERS) for r in heard):
                text = "the autopilot obeys commands that are not signed"
                return Finding("signing", Level.RED, text, _SETUP)
    return Finding("signing", Level.GREEN, "the autopilot ignores commands that are not signed")


def examine_open(config: CompanionConfig) -> Finding | None:
    """Return a finding about a vehicle that has obeyed unsigned commands; None on a cable."""
    kind, host, _ = parse_endpoint(config.link.endpoint)
    if kind == "serial" or host in ("127.0.0.1", "localhost"):
        return None
    text = f"anybody on the network of {config.link.endpoint} can command the vehicle"
    return Finding("signing", Level.RED, text, "link.signing; docs/faults.md says how")


def sign(config: CompanionConfig, link: Link) -> None:
    """Let a link sign from now on, unless the key is one that only the service can read."""
    signing = config.link.signing
    if signing is None or not find_key(signing.key, os.environ).exists():
        return
    try:
        made = open_signing(config.name, signing.key, signing.link_id).signing
    except SigningKeyError:
        return
    link.codec = Codec(config.link.system_id, config.link.component_id, signing=made)
