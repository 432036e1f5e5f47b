"""The flight log: one MCAP file, JSON records, chunks small enough to survive a cut."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from companion.pipeline import TickOutputs
from companion.types import Vector

_CHUNK = 64 * 1024
_DIGITS = 4


class Recorder:
    """Writes one record a tick to `path`; a disk that fails ends the log, never the flight."""

    def __init__(self, path: Path, name: str) -> None:
        self.failed: str | None = None
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
        self._writer.start(profile="swarm-companion", library="swarm-companion")
        schema = self._writer.register_schema("Tick", "jsonschema", b'{"type": "object"}')
        self._channel = self._writer.register_channel("/tick", "json", schema, {"drone": name})
        self._count = 0

    def write(self, out: TickOutputs, counters: dict[str, Any]) -> None:
        """Append a tick; counters: link and deadline counts so far."""
        if self.failed is not None:
            return
        stamp = round(out.time * 1e9)
        data = json.dumps(record(out) | {"counters": counters}, separators=(",", ":")).encode()
        try:
            self._writer.add_message(self._channel, stamp, data, stamp, self._count)
        except OSError as error:
            self.failed = f"flight log ended: {error}"
        self._count += 1

    def close(self) -> None:
        """Finish the file so that indexed readers open it."""
        if self.failed is None:
            try:
                self._writer.finish()  # type: ignore[no-untyped-call]
            except OSError as error:
                self.failed = f"flight log ended: {error}"
        self._file.close()


def record(out: TickOutputs) -> dict[str, Any]:
    """A tick as plain data: what reports, replays and studies read."""
    r: dict[str, Any] = {
        "time": out.time,
        "phase": out.phase.value,
        "yaw": _round(out.yaw),
        "speed": _round(out.speed),
        "hover_thrust": _round(out.hover_thrust),
        "stages_ms": {k: round(v * 1e3, 3) for k, v in out.stages.items()},
        "detections": [
            [*_list(d.direction), _round(d.range), _round(d.score)] for d in out.sighting.drones
        ],
        "trunks": [
            [*_list(t.direction), _round(t.distance), _round(t.radius)] for t in out.sighting.trunks
        ],
        "tracks": [
            {
                "id": t.id,
                "p": _list(t.p),
                "v": _list(t.v),
                "unseen": _round(t.unseen),
                "sigma": _round(float(np.sqrt(np.trace(t.P[:3, :3]) / 3))),
            }
            for t in out.tracks
        ],
        "critical": [[t.id, _round(threat)] for t, threat in out.critical],
        "cylinders": [_list(c) for c in out.obstacles.cylinders[:12]],
    }
    if out.own is not None:
        r["own"] = {"p": _list(out.own.p), "v": _list(out.own.v), "q": _list(out.own.q_wb),
                    "omega": _list(out.own.omega)}  # fmt: skip
    if out.progress is not None:
        r["goal"] = {"p": _list(out.progress.goal), "index": out.progress.index}
    if out.result is not None:
        s = out.result
        r["solver"] = {
            "status": s.status.value,
            "usable": s.usable,
            "iterations": s.iterations,
            "solve_ms": round(s.solve_time * 1e3, 3),
            "step_norm": _round(s.step_norm),
            "slack": [_round(s.slack_agent), _round(s.slack_obstacle), _round(s.slack_plane)],
            "active": list(s.active),
            "cost": _round(s.cost),
        }
        r["plan"] = [_list(x) for x in s.x[:, :3]]
    if out.verdict is not None:
        v = out.verdict
        r["command"] = {"omega": _list(v.command.omega), "c": _round(v.command.c),
                        "reason": v.reason.value, "bad_ticks": v.bad_ticks}  # fmt: skip
    return r


def _round(value: float) -> float:
    return round(float(value), _DIGITS)


def _list(vector: Vector) -> list[float]:
    return [round(float(a), _DIGITS) for a in vector]
