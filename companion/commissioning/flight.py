"""A commissioning flight read from its log."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.commissioning.attitude_curve import AttitudeCurve
from companion.estimation.own_state import OwnState
from companion.flightlog import corners
from companion.flightlog.reader import FlightLog, read_log
from companion.flightlog.replay import configured
from companion.perception.camera import Camera
from companion.perception.corner_pairs import CornerPairs
from companion.settings.config import CompanionConfig
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.mcap_file import LogError, read_messages, read_metadata
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Source

_PERIOD = 0.05  # s, of the own state


@dataclass(frozen=True)
class CommissioningFlight:
    """What a log holds of one flight.

    config: it was flown with. camera: lens of that, on its mount without `mount_deg`. curve: own
    attitude. states: (n,7) time [s], p [m], v [m/s], world ENU. pairs: corners.
    ticks: those at which the companion flew.
    """

    config: CompanionConfig
    camera: Camera
    curve: AttitudeCurve
    states: Vector
    pairs: list[CornerPairs]
    ticks: list[dict[str, Any]]


def read_flight(path: Path) -> CommissioningFlight:
    """Read a flight.

    Raises:
        LogError: no flight log, or none of a commissioning flight; the message says why.
        SettingsError: the recorded configuration is not valid any more.
    """
    log = read_log(path)
    config = configured(log)
    metadata = read_metadata(path)
    if corners.CAMERA not in metadata:
        raise LogError(
            f"{path}: holds no corners: fly with mission.commission (`companion run --commission`) "
            "or log.corners"
        )
    try:
        data = json.loads(metadata[corners.CAMERA]["calibration"])
        pairs = [corners.decode(m.data) for _, m in read_messages(path, [corners.TOPIC])]
    except (ValueError, KeyError) as error:
        raise LogError(f"{path}: its corners cannot be read: {error}") from error
    ticks = [t for t in log.ticks if t["phase"] == "fly" and "command" in t and "own" in t]
    attitudes, states = _states(log, config)
    if len(attitudes) < 2 or not ticks:
        raise LogError(f"{path}: the companion never flew in it")
    camera = Camera.from_data(data)
    return CommissioningFlight(config, camera, AttitudeCurve(attitudes), states, pairs, ticks)


def _states(log: FlightLog, config: CompanionConfig) -> tuple[list[Attitude], Vector]:
    """Return all attitudes, and the own state at each multiple of `_PERIOD`."""
    link = config.link
    codec = Codec(link.system_id, link.component_id, link.heard())
    take = codec.decode_datagram if link.endpoint.startswith("udp") else codec.decode
    autopilot, own = Source(link.system_id, 1), OwnState()
    attitudes: list[Attitude] = []
    rows: list[Vector] = []
    for inputs in log.inputs:
        heard = [r for d in inputs.datagrams for r in take(d)]
        own.add([r.message for r in heard if r.source == autopilot])
        attitudes += own.new_attitudes
        # A little after the samples around it have come.
        first = rows[-1][0] + _PERIOD if rows else inputs.time - 2.0 * _PERIOD
        for time in np.arange(first, inputs.time - _PERIOD, _PERIOD):
            if (state := own.at(float(time))) is not None:
                rows.append(np.concatenate([[time], state.p, state.v]))
    return attitudes, np.array(rows).reshape(-1, 7)
