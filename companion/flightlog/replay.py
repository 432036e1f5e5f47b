"""Replay: a recorded flight through the present code, compared with its log.

The companion gets the recorded telemetry bytes and detections of each tick. Its decisions are
compared exactly, numbers within a tolerance. The vehicle is not simulated: the inputs of each tick
are the recorded ones, even where the present code commands something else.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
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
HOVER_TOLERANCE = 2e-4  # twice the log's last digit
_NAME = "the log's configuration"
_DECISIONS = ("phase", "goal.index", "command.reason", "solver.usable", "solver.active")


@dataclass(frozen=True)
class Difference:
    """A difference between log and present code: tick number, time [s], name of the value."""

    tick: int
    time: float
    what: str
    recorded: Any
    today: Any


@dataclass(frozen=True)
class Outcome:
    """The result of a replay.

    ticks: how many were compared. differing: how many differ. first: the first difference. omega
    [rad/s], c [m/s²]: the largest difference of body rates and collective acceleration.
    """

    ticks: int
    differing: int
    first: Difference | None
    omega: float
    c: float

    def text(self) -> str:
        """Return the result as a text."""
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
    """Replay a log with the keys that its configuration set and the present defaults.

    overrides: path.to.key=value, on top of the recorded configuration.

    Raises:
        SettingsError: the recorded configuration is not valid any more.
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
    """Return the log's configuration with the present defaults and keys.

    Raises:
        SettingsError: the recorded configuration is not valid any more.
    """
    recorded = json.dumps(upgraded(log.config, FILEVERSION))
    document = merge([parse_yaml(recorded, _NAME), assignments(overrides or [])])
    return validate(CompanionConfig, document, _NAME)


def differences(
    number: int, recorded: dict[str, Any], today: dict[str, Any]
) -> Iterator[Difference]:
    """Return the differences between two records of the same tick, decisions first."""
    pairs = [(name, _at(recorded, name), _at(today, name)) for name in _DECISIONS]
    ids = [[i for i, _ in r["critical"]] for r in (recorded, today)]
    pairs.append(("critical", ids[0], ids[1]))
    for what, before, now in pairs:
        if before != now:
            yield Difference(number, recorded["time"], what, before, now)
    hovers = recorded["hover_thrust"], today["hover_thrust"]
    if abs(hovers[0] - hovers[1]) > HOVER_TOLERANCE:
        yield Difference(number, recorded["time"], "hover_thrust", *hovers)
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
    """Return the present code's record of each tick."""
    return (orjson.loads(records.encode(tick, {}, {})) for tick in flown(config, recorded))


def flown(
    config: CompanionConfig,
    recorded: Iterable[RecordedInputs],
    stopwatch: Callable[[], float] = time.perf_counter,
) -> Iterator[Tick]:
    """Return the present code's results of each tick; stopwatch: s, for the times of its stages."""
    companion = Companion(_without_pixels(config), stopwatch)
    codec = Codec(config.link.system_id, config.link.component_id, config.link.heard())
    whole = config.link.endpoint.startswith("udp")  # a stream may be cut anywhere
    take = codec.decode_datagram if whole else codec.decode
    for inputs in recorded:
        received = [r for d in inputs.datagrams for r in take(d)]
        yield companion.tick(
            TickInputs(inputs.time, received, _frame(inputs), inputs.leave, inputs.latest)
        )


def _without_pixels(config: CompanionConfig) -> CompanionConfig:
    """Return the configuration with detections from the frames: the log keeps no pixels."""
    given = config.sensing.model_copy(update={"neighbours": "truth", "obstacles": "map"})
    return config.model_copy(update={"sensing": given})


def _frame(inputs: RecordedInputs) -> Frame | None:
    """Return the newest frame with its detections, in the layout of the frame channel."""
    if inputs.frame_time is None:
        return None
    stamp, lag = inputs.frame_time + inputs.lag, inputs.lag
    if not inputs.shown:
        return Frame(stamp, lag=lag)
    drones = [
        [*d.direction, d.range, d.sigma_bearing, d.sigma_range, d.sigma_lasting]
        for d in inputs.drones
    ]
    trunks = [
        [*t.direction, t.distance, t.radius, t.sigma, t.assumed, t.half_width]
        for t in inputs.trunks
    ]
    arrays = {
        "neighbours": np.array(drones).reshape(-1, 7),
        "trunks": np.array(trunks).reshape(-1, 8),
    }
    if inputs.partly:
        arrays["partly"] = np.ones((1, 1))
    if len(inputs.fixed):
        arrays["fixed"] = inputs.fixed
    if inputs.flow is not None:
        arrays["flow"] = inputs.flow
    if inputs.ranges is not None:
        arrays["ranges"] = inputs.ranges
    return Frame(stamp, arrays, lag=lag)


def _gap(recorded: dict[str, Any], today: dict[str, Any], name: str) -> float:
    """Return the largest difference of a value of the commands; 0 where one has no command."""
    if "command" not in recorded or "command" not in today:
        return 0.0
    before, now = recorded["command"][name], today["command"][name]
    return float(np.abs(np.subtract(before, now)).max())


def _at(record: dict[str, Any], path: str) -> Any:
    value: Any = record
    for key in path.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value
