"""A tick as plain data for the log's `/tick` topic: what reports, viewers and studies read.

Own ENU frame, SI, radians; times in the vehicle's clock [s]; `*_ms` in milliseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import orjson
from numpy.typing import ArrayLike

from companion.pipeline import TickOutputs
from mavlink_bridge.shared.arrays import Vector

_DIGITS = 4  # 0.1 mm, 0.006°
_OBSTACLES = 12  # nearest ones written
_OPTIONS = orjson.OPT_SERIALIZE_NUMPY

SCHEMA = {
    "type": "object",
    "title": "swarm_companion.Tick",
    "properties": {
        "time": {"type": "number"},
        "phase": {"type": "string"},
        "eye": {"type": "string"},
        "own": {"type": "object"},
        "goal": {"type": "object"},
        "aim": {"type": "array"},
        "detections": {"type": "array"},
        "trunks": {"type": "array"},
        "tracks": {"type": "array"},
        "critical": {"type": "array"},
        "cylinders": {"type": "array"},
        "plan": {"type": "array"},
        "solver": {"type": "object"},
        "command": {"type": "object"},
        "stages_ms": {"type": "object"},
        "counters": {"type": "object"},
    },
}


def encode(out: TickOutputs, counters: dict[str, Any]) -> bytes:
    """The tick as JSON; counters: of link and deadlines so far."""
    return orjson.dumps(record(out) | {"counters": counters}, option=_OPTIONS)


def record(out: TickOutputs) -> dict[str, Any]:
    """The tick as a dictionary of numbers, strings and arrays."""
    r: dict[str, Any] = {
        "time": out.time,
        "phase": out.phase.value,
        "eye": out.trouble.value,
        "yaw": _number(out.yaw),
        "speed": _number(out.speed),
        "hover_thrust": _number(out.hover_thrust),
        "stages_ms": {k: round(v * 1e3, 3) for k, v in out.stages.items()},
        **_seen(out),
        "critical": [[t.id, _number(threat)] for t, threat in out.critical],
        "cylinders": _rounded(out.obstacles.cylinders[:_OBSTACLES]),
    }
    if out.own is not None:
        own = _rounded(np.concatenate([out.own.p, out.own.v, out.own.q_wb, out.own.omega]))
        r["own"] = {"p": own[:3], "v": own[3:6], "q": own[6:10], "omega": own[10:]}
    if out.progress is not None:
        r["goal"] = {"p": _rounded(out.progress.goal), "index": out.progress.index}
        r["aim"] = _rounded(out.aim)
    return r | _planned(out) | _commanded(out)


def _seen(out: TickOutputs) -> dict[str, Any]:
    """Detections and trunks of a new frame, camera frame, and the tracks."""
    drones = [[*d.direction.tolist(), d.range, d.score] for d in out.sighting.drones]
    trunks = [[*t.direction.tolist(), t.distance, t.radius] for t in out.sighting.trunks]
    state = [
        [*t.p.tolist(), *t.v.tolist(), t.unseen, (np.einsum("ii", t.P[:3, :3]) / 3) ** 0.5]
        for t in out.tracks
    ]
    rows = _rounded(state)
    return {
        "frame": out.sighting.time if out.sighting.own is not None else None,
        "detections": _rounded(drones),
        "trunks": _rounded(trunks),
        "tracks": [
            {"id": t.id, "p": row[:3], "v": row[3:6], "unseen": row[6], "sigma": row[7]}
            for t, row in zip(out.tracks, rows, strict=True)
        ],
    }


def _planned(out: TickOutputs) -> dict[str, Any]:
    if out.result is None:
        return {}
    s = out.result
    solver = {
        "status": s.status.value,
        "usable": s.usable,
        "iterations": s.iterations,
        "solve_ms": round(s.solve_time * 1e3, 3),
        "step_norm": _number(s.step_norm),
        "slack": [_number(s.slack_agent), _number(s.slack_obstacle), _number(s.slack_plane)],
        "active": list(s.active),
        "cost": _number(s.cost),
    }
    return {"solver": solver, "plan": _rounded(s.x[:, :3])}


def _commanded(out: TickOutputs) -> dict[str, Any]:
    if out.verdict is None:
        return {}
    v = out.verdict
    command = {"omega": _rounded(v.command.omega), "c": _number(v.command.c),
               "reason": v.reason.value, "bad_ticks": v.bad_ticks}  # fmt: skip
    return {"command": command}


def _number(value: float) -> float:
    return round(float(value), _DIGITS)


def _rounded(values: ArrayLike) -> Vector:
    array: Vector = np.asarray(values, dtype=np.float64)
    return array.round(_DIGITS)
