"""A recorded flight through today's code: are its decisions and commands still the same?

The pipeline gets each tick's recorded telemetry bytes and what its frame showed, and is
compared with what the log says: decisions exactly, numbers within a tolerance. The vehicle
is not simulated: each tick's inputs are the recorded ones, whatever today's code commands.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson

from companion.flightlog import record as records
from companion.flightlog.inputs import RecordedInputs
from companion.flightlog.reader import FlightLog
from companion.pipeline import Companion
from companion.settings.config import FILEVERSION, CompanionConfig
from companion.settings.renamed import upgraded
from companion.tick import Tick, TickInputs
from mavlink_bridge.shared.settings import assignments, merge, parse_yaml, validate
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.video import Frame

COMMAND_TOLERANCE = 1e-3  # rad/s and m/s²: ten times the log's last digit
_NAME = "the log's configuration"
_DECISIONS = ("phase", "goal.index", "command.reason", "solver.usable", "solver.active")


@dataclass(frozen=True)
class Difference:
    """Where today's code and the log part: tick number, its time [s], the value's name."""

    tick: int
    time: float
    what: str
    recorded: Any
    today: Any


@dataclass(frozen=True)
class Outcome:
    """What a replay found.

    ticks compared, and how many differ; the first difference; the largest difference of a
    command over all ticks: body rates [rad/s], collective acceleration [m/s²].
    """

    ticks: int
    differing: int
    first: Difference | None
    omega: float
    c: float

    def text(self) -> str:
        """For a person."""
        if self.first is None:
            return (
                f"{self.ticks} ticks: decisions the same, commands within {COMMAND_TOLERANCE} "
                f"(largest difference {self.omega:.1e} rad/s, {self.c:.1e} m/s²)"
            )
        f = self.first
        return (
            f"{self.differing} of {self.ticks} ticks differ; first at tick {f.tick}, "
            f"t = {f.time:.3f} s: {f.what}: recorded {f.recorded}, today {f.today}\n"
            f"largest difference of commands: {self.omega:.4f} rad/s, {self.c:.4f} m/s²"
        )


def replay(log: FlightLog, overrides: list[str] | None = None) -> Outcome:
    """Fly the log again, with what its configuration set and today's defaults.

    overrides change the configuration (path.to.key=value).

    Raises:
        SettingsError: today's code does not accept the recorded configuration.
    """
    config = configured(log, overrides)
    differing, first, omega, c = 0, None, 0.0, 0.0
    for number, (today, recorded) in enumerate(
        zip(rerun(config, log.inputs), log.ticks, strict=True)
    ):
        found = list(differences(number, recorded, today))
        differing += bool(found)
        first = first or next(iter(found), None)
        omega = max(omega, _gap(recorded, today, "omega"))
        c = max(c, _gap(recorded, today, "c"))
    return Outcome(len(log.ticks), differing, first, omega, c)


def configured(log: FlightLog, overrides: list[str] | None = None) -> CompanionConfig:
    """What the log's configuration set, with today's defaults.

    Raises:
        SettingsError: today's code does not accept it.
    """
    recorded = json.dumps(upgraded(log.config, FILEVERSION))
    document = merge([parse_yaml(recorded, _NAME), assignments(overrides or [])])
    return validate(CompanionConfig, document, _NAME)


def differences(
    number: int, recorded: dict[str, Any], today: dict[str, Any]
) -> Iterator[Difference]:
    """Where two records of the same tick part, decisions first."""
    pairs = [(name, _at(recorded, name), _at(today, name)) for name in _DECISIONS]
    ids = [[i for i, _ in r["critical"]] for r in (recorded, today)]
    pairs.append(("critical", ids[0], ids[1]))
    for what, before, now in pairs:
        if before != now:
            yield Difference(number, recorded["time"], what, before, now)
    for name in ("omega", "c"):
        if _gap(recorded, today, name) > COMMAND_TOLERANCE:
            yield Difference(
                number,
                recorded["time"],
                f"command.{name}",
                recorded["command"][name],
                today["command"][name],
            )


def rerun(config: CompanionConfig, recorded: Iterable[RecordedInputs]) -> Iterator[dict[str, Any]]:
    """Today's record of each tick."""
    return (orjson.loads(records.encode(tick, {}, {})) for tick in flown(config, recorded))


def flown(config: CompanionConfig, recorded: Iterable[RecordedInputs]) -> Iterator[Tick]:
    """Today's outputs of each tick."""
    companion = Companion(_without_pixels(config), time.perf_counter)
    codec = Codec(config.link.system_id, config.link.component_id, config.link.heard())
    whole = config.link.endpoint.startswith("udp")  # as opposed to a stream, cut anywhere
    take = codec.decode_datagram if whole else codec.decode
    for inputs in recorded:
        received = [r for d in inputs.datagrams for r in take(d)]
        yield companion.tick(TickInputs(inputs.time, received, _frame(inputs), inputs.leave))


def _without_pixels(config: CompanionConfig) -> CompanionConfig:
    """The same, but told by each frame what is in it: as the log keeps no pixels."""
    told = config.sensing.model_copy(update={"neighbours": "truth", "obstacles": "map"})
    return config.model_copy(update={"sensing": told})


def _frame(inputs: RecordedInputs) -> Frame | None:
    """The newest frame with what it showed, in the layout of the frame channel."""
    if inputs.frame_time is None:
        return None
    if not inputs.shown:
        return Frame(inputs.frame_time)
    drones = [[*d.direction, d.range, d.sigma_bearing, d.sigma_range] for d in inputs.drones]
    trunks = [[*t.direction, t.distance, t.radius, t.sigma, t.assumed] for t in inputs.trunks]
    arrays = {
        "neighbours": np.array(drones).reshape(-1, 6),
        "trunks": np.array(trunks).reshape(-1, 7),
    }
    if inputs.ranges is not None:
        arrays["ranges"] = inputs.ranges
    return Frame(inputs.frame_time, arrays)


def _gap(recorded: dict[str, Any], today: dict[str, Any], name: str) -> float:
    """Largest difference of the commands' values of this name; 0 where one has no command."""
    if "command" not in recorded or "command" not in today:
        return 0.0
    before, now = recorded["command"][name], today["command"][name]
    return float(np.abs(np.subtract(before, now)).max())


def _at(record: dict[str, Any], path: str) -> Any:
    value: Any = record
    for key in path.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value
