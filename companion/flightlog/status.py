"""The present state of a daemon, from the end of its flight log."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import orjson

from companion.settings.config import load_config
from mavlink_bridge.shared.mcap_file import Follower, check_begins

_SERVICE_LOGS = Path("/var/log/swarm-companion")  # LogsDirectory of the systemd unit
_STALE = 2.0  # s without a new record after which the daemon does not run


class NoStatus(ValueError):
    """The state of a daemon is not known; the message says why."""


class Status:
    """Follows the flight log of a drone's file, or the flight log given.

    Raises:
        SettingsError, LogError, NoStatus: no such file or log, or a file that sets no log.
    """

    def __init__(self, path: Path) -> None:
        self.record: dict[str, Any] = {}
        self.refused: dict[str, Any] = {}  # the last tick in which the autopilot refused
        log = path if path.suffix == ".mcap" else _log_of(path)
        check_begins(log)
        self._path, self._follower = log, Follower(log, "/tick")

    def update(self) -> None:
        """Read the newest tick.

        Raises:
            NoStatus: the log has no tick so far.
        """
        messages = self._follower.new()
        for message in reversed(messages):
            if b'"refusals":["' in message.data:
                self.refused = orjson.loads(message.data)
                break
        if messages:
            self.record = orjson.loads(messages[-1].data)
        if not self.record:
            raise NoStatus(f"{self._path}: no tick so far")

    def text(self) -> str:
        """Return the state as a text."""
        r = self.record
        age = time.time() - self._path.stat().st_mtime  # noqa: TID251  (file times are wall time)
        stages = ", ".join(f"{k} {v:.1f}" for k, v in r["stages_ms"].items())
        nearest = min((_distance(t, r) for t in r["tracks"]), default=None)
        command = r.get("command", {})
        lines = [
            f"{'not running, last' if age > _STALE else 'running,'} tick at {r['time']:.1f} s",
            f"phase    {r['phase']}, target {r.get('goal', {}).get('index', 0) + 1}",
            f"guard    {command.get('reason', '-')}, {command.get('bad_ticks', 0)} bad ticks",
            f"proof    {_certificate(r.get('certificate'))}",
            f"solver   {_solver(r.get('solver'))}",
            f"stages   {stages} ms",
            f"tracks   {len(r['tracks'])}, {len(r['critical'])} critical, nearest "
            + ("-" if nearest is None else f"{nearest:.1f} m"),
            f"motion   {_motion(r)}",
            f"seen     {len(r['detections'])} drones, {len(r['trunks'])} trunks",
            f"hover    {_hover(r)}",
            f"clock    {_clock(r.get('clock'))}",
            "counts   " + ", ".join(f"{k} {v}" for k, v in r["counters"].items()),
        ]
        if self.refused:
            told = "; ".join(self.refused["refusals"])
            lines.insert(2, f"refused  {told}, at {self.refused['time']:.1f} s")
        return "\n".join(lines)


def _log_of(config: Path) -> Path:
    """Return the newest log of a drone's file, here or where the service writes it."""
    settings = load_config(config)
    if settings.log.path is None:
        raise NoStatus(f"{config}: log.path: not set, and the status comes from the flight log")
    pattern = settings.log.path.replace("{time}", "*")
    folders = [Path(), _SERVICE_LOGS / settings.name]
    found = [log for folder in folders for log in _matching(folder / pattern)]
    if not found:
        places = " or ".join(str(folder / pattern) for folder in folders)
        raise NoStatus(f"{config}: no flight log at {places}")
    return max(found, key=lambda log: log.stat().st_mtime)


def _matching(pattern: Path) -> list[Path]:
    return list(pattern.parent.glob(pattern.name))


def _distance(track: dict[str, Any], record: dict[str, Any]) -> float:
    own = record.get("own", {}).get("p", [0.0, 0.0, 0.0])
    return float(sum((a - b) ** 2 for a, b in zip(track["p"], own, strict=True)) ** 0.5)


def _hover(record: dict[str, Any]) -> str:
    """Return the hover thrust, its doubt, and where it is known from."""
    hover = record.get("hover")
    if hover is None:  # a log of before
        return f"thrust {record['hover_thrust']:.3f}"
    return f"thrust {record['hover_thrust']:.3f} ±{hover['doubt']:.1%}, from {hover['source']}"


def _clock(clock: dict[str, Any] | None) -> str:
    """Return the rate of the vehicle's clock against this board's, and the doubt of its offset."""
    if clock is None:
        return "the sender's of the frames"
    doubt = clock["rate_doubt"]
    rate = "rate not measured" if doubt is None else f"rate {clock['rate']:.4f} ±{doubt:.4f}"
    by = "" if clock["bounded"] else " (TIMESYNC is not answered)"
    return f"{rate}, ±{clock['doubt_ms']:.0f} ms{by}, {clock['jumps']} jumps"


def _certificate(found: dict[str, Any] | None) -> str:
    """Return what flies with which certificate; a log of before has none."""
    if not found:
        return "-"
    judged = "flown" in found
    text = [f"{found['flown']}, {found['margin']:+.2f} m to {found['cause']}"] if judged else []
    return "; ".join([*text, *found["beyond"]])


def _solver(solver: dict[str, Any] | None) -> str:
    if solver is None:
        return "-"
    return f"{solver['status']}, {solver['solve_ms']:.1f} ms, {solver['iterations']} iterations"


def _motion(record: dict[str, Any]) -> str:
    """Return what is measured in flight, with its doubt; a log of before has none of it."""
    texts = []
    if "delay" in record:
        value, sigma = record["delay"]
        texts.append(f"delay {value * 1e3:.0f} ± {sigma * 1e3:.0f} ms")
    if record.get("velocity_lag", [0.0])[0]:
        value, sigma = record["velocity_lag"]
        texts.append(f"velocity late by {value * 1e3:.0f} ± {sigma * 1e3:.0f} ms")
    if record.get("height"):
        value, sigma = record["height"]
        texts.append(f"over ground {value:.1f} ± {sigma:.1f} m")
    if any(record.get("ground_rise", [])):
        slope = math.degrees(math.atan(math.hypot(*record["ground_rise"])))
        texts.append(f"on a slope of {slope:.0f}°")
    if len(record.get("velocity_by_sight", [])) == 3:
        east, north, sigma = record["velocity_by_sight"]
        texts.append(f"velocity wrong by {math.hypot(east, north):.2f} ± {sigma:.2f} m/s")
    if "heading_by_sight" in record:
        value, sigma = map(math.degrees, record["heading_by_sight"])
        texts.append(f"heading by {value:.0f} ± {sigma:.0f}°")
    return ", ".join(texts) or "-"
