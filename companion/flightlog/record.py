"""A tick as plain data for the log's `/tick` topic, which reports, viewers and studies read.

Own ENU frame on the map, SI, radians; times in the vehicle's clock [s]; `*_ms` in milliseconds.
`map_offset` is already in all places.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import orjson
from numpy.typing import ArrayLike

from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.vehicle_clock import ClockEstimate
from companion.guidance.guidance import Reference
from companion.perception.camera_alignment import Alignment
from companion.perception.frontend import Detections
from companion.tick import Tick
from companion.types import Plan, Track
from mavlink_bridge.shared.arrays import Vector

_DIGITS = 4  # 0.1 mm, 0.006°
_OBSTACLES = 12  # nearest cylinders written
_LEVEL = np.array([1.0, 1.0, 0.0])
_OPTIONS = orjson.OPT_SERIALIZE_NUMPY

SCHEMA = {
    "type": "object",
    "title": "swarm_companion.Tick",
    "properties": {
        "time": {"type": "number"},
        "phase": {"type": "string"},
        "inhibit": {"type": "string"},
        "camera": {"type": "string"},
        "alignment": {"type": "object"},
        "broken": {"type": "string"},
        "certificate": {"type": "object"},
        "clarity": {"type": "number"},
        "refusals": {"type": "array"},
        "own": {"type": "object"},
        "goal": {"type": "object"},
        "aim": {"type": "array"},
        "target": {"type": "array"},
        "route": {"type": "array"},
        "speed": {"type": "number"},
        "speed_limit": {"type": "string"},
        "strangers": {"type": "array"},
        "v_max": {"type": "number"},
        "yaw": {"type": "number"},
        "frame": {"type": ["number", "null"]},
        "detections": {"type": "array"},
        "trunks": {"type": "array"},
        "tracks": {"type": "array"},
        "critical": {"type": "array"},
        "cylinders": {"type": "array"},
        "plan": {"type": "array"},
        "solver": {"type": "object"},
        "command": {"type": "object"},
        "hover_thrust": {"type": "number"},
        "delay": {"type": "array"},
        "velocity_lag": {"type": "array"},
        "velocity_by_sight": {"type": "array"},
        "heading_by_sight": {"type": "array"},
        "map_offset": {"type": "array"},
        "height": {"type": "array"},
        "ground_rise": {"type": "array"},
        "hover": {"type": "object"},
        "stages_ms": {"type": "object"},
        "counters": {"type": "object"},
        "clock": {"type": ["object", "null"]},
    },
}


def encode(
    tick: Tick,
    counters: dict[str, Any],
    costs: dict[str, float],
    clock: ClockEstimate | None = None,
) -> bytes:
    """Return the tick as JSON.

    counters: of link and deadlines, so far. costs: s, of work that is no stage of the tick. clock:
    of the vehicle, where it is estimated.
    """
    r = record(tick, costs) | {"counters": counters | {"stamps_ahead": tick.vehicle.ahead}}
    return orjson.dumps(r | {"clock": _clock(clock)}, option=_OPTIONS)


def _hover(hover: HoverEstimate) -> dict[str, Any]:
    """Return the doubt of the hover thrust and where it is known from."""
    doubt, mismatch = _number(hover.doubt), _number(hover.mismatch)
    exponent = _number(hover.map.exponent)
    return {
        "doubt": doubt,
        "source": hover.source,
        "mismatch": mismatch,
        "exponent": exponent,
    }


def _clock(clock: ClockEstimate | None) -> dict[str, Any] | None:
    """Return the rate of the vehicle's clock and its doubts; JSON has no infinity."""
    if clock is None:
        return None
    rate_doubt = round(clock.rate_doubt, 6) if clock.measured else None
    known = {"rate": round(clock.rate, 6), "rate_doubt": rate_doubt}
    more = {"doubt_ms": round(clock.doubt * 1e3, 2), "bounded": clock.bounded}
    return known | more | {"jumps": clock.jumps}


def record(tick: Tick, costs: dict[str, float] | None = None) -> dict[str, Any]:
    """Return the tick as a dictionary of numbers, strings and lists."""
    stages, offset = tick.stages | (costs or {}), tick.vehicle.map_offset
    height, sight = tick.vehicle.height, tick.vehicle.by_sight
    r: dict[str, Any] = {
        "time": tick.time,
        "phase": tick.supervised.phase.value,
        "inhibit": tick.supervised.inhibit_reason,
        "camera": tick.seen.fault.value,
        "alignment": _alignment(tick.seen.alignment),
        "clarity": _number(tick.seen.clarity),
        "broken": "" if tick.broken is None else tick.broken.finding,
        "refusals": list(tick.vehicle.refusals),
        "hover_thrust": _number(tick.motion.thrust_map.hover_thrust),
        "delay": _numbers(tick.motion.delay.value, tick.motion.delay.sigma),
        "velocity_lag": _numbers(tick.vehicle.lag.value, tick.vehicle.lag.sigma),
        "velocity_by_sight": _numbers(*sight.error[:2].tolist(), sight.sigma),
        "heading_by_sight": _numbers(sight.turn, sight.turn_sigma),
        "hover": _hover(tick.motion.hover),
        "stages_ms": {k: round(v * 1e3, 3) for k, v in stages.items()},
        **_seen(tick.seen),
        "map_offset": _rounded(offset),
        "height": [] if height is None else _numbers(height.value, height.sigma),
        "ground_rise": [] if height is None else _numbers(*height.ground.rise),
        "tracks": _tracks(tick.tracks, offset),
        "cylinders": _rounded(tick.obstacles.cylinders[:_OBSTACLES] + offset * _LEVEL),
        **_guided(tick.reference, offset),
    }
    state = tick.vehicle.state
    if state is not None:
        own = _rounded(np.concatenate([state.p + offset, state.v, state.q_wb, state.omega]))
        r["own"] = {"p": own[:3], "v": own[3:6], "q": own[6:10], "omega": own[10:]}
    return r | _planned(tick.planned.plan, offset) | _commanded(tick)


def _seen(seen: Detections) -> dict[str, Any]:
    """Return the detections and trunks of a new frame, in the camera frame."""
    drones = [[*d.direction.tolist(), d.range, d.score] for d in seen.drones]
    trunks = [[*t.direction.tolist(), t.distance, t.radius] for t in seen.trunks]
    return {
        "frame": seen.time if seen.own is not None else None,
        "detections": _rounded(drones),
        "trunks": _rounded(trunks),
    }


def _tracks(tracks: list[Track], offset: Vector) -> list[dict[str, Any]]:
    state = [[*(t.p + offset).tolist(), *t.v.tolist(), t.unseen, _mean_sigma(t)] for t in tracks]
    return [
        {"id": t.id, "p": row[:3], "v": row[3:6], "unseen": row[6], "sigma": row[7]}
        for t, row in zip(tracks, _rounded(state), strict=True)
    ]


def _mean_sigma(track: Track) -> float:
    """Return the 1 σ [m] of a track's position, in the mean of the three axes."""
    east, north, up, *_ = track.P.diagonal().tolist()
    return math.sqrt((east + north + up) / 3)


def _guided(reference: Reference | None, offset: Vector) -> dict[str, Any]:
    """Return the reference and its reasons; `target` is the goal that the solver gets."""
    if reference is None:
        return {"critical": [], "yaw": 0.0, "speed": 0.0}
    places = np.array([reference.progress.goal, reference.aim, reference.target])
    goal, aim, target = _rounded(places + offset)
    return {
        "goal": {"p": goal, "index": reference.progress.index},
        "aim": aim,
        "target": target,
        "route": reference.route,
        "speed": _number(reference.speed),
        "speed_limit": reference.speed_limit,
        "strangers": sorted(reference.strangers),
        "v_max": _number(reference.v_max),
        "yaw": _number(reference.yaw),
        "critical": [[t.id, _number(threat)] for t, threat in reference.critical],
    }


def _planned(plan: Plan | None, offset: Vector) -> dict[str, Any]:
    if plan is None:
        return {}
    solver = {
        "status": plan.status.value,
        "usable": plan.usable,
        "iterations": plan.iterations,
        "solve_ms": round(plan.solve_time * 1e3, 3),
        "step_norm": _number(plan.step_norm),
        "slack": _numbers(plan.slack_agent, plan.slack_obstacle, plan.slack_plane),
        "active": list(plan.active),
        "cost": _number(plan.cost),
    }
    return {"solver": solver, "plan": _rounded(plan.x[:, :3] + offset)}


def _commanded(tick: Tick) -> dict[str, Any]:
    v = tick.supervised.verdict
    if v is None:
        return {}
    command = {
        "omega": _rounded(v.command.omega),
        "c": _number(v.command.c),
        "reason": v.reason.value,
        "bad_ticks": v.bad_ticks,
    }
    return {"command": command, "certificate": _certificate(tick)}


def _certificate(tick: Tick) -> dict[str, Any]:
    """Return what flew with which certificate, the room left over [m] and what is there.

    Of a tick that was not judged: broken bounds alone, if there are any.
    """
    beyond: dict[str, Any] = {"beyond": list(tick.beyond)}
    c = tick.supervised.certified
    if c is None:
        return beyond if tick.beyond else {}
    return beyond | {"flown": c.flown.value, "margin": _number(c.margin), "cause": c.cause}


def _alignment(a: Alignment) -> dict[str, Any]:
    """Return how the pictures turn against the gyro, as logged: s, times, rad, and 1 σ."""
    return {
        "lag": _number(a.lag),
        "scale": _number(a.scale),
        "tilt": _numbers(*a.tilt),
        "sigmas": _numbers(*a.sigmas),
    }


def _number(value: float) -> float:
    return round(float(value), _DIGITS)


def _numbers(*values: float) -> list[float]:
    return [_number(value) for value in values]


def _rounded(values: ArrayLike) -> list[Any]:
    """Return an array as nested lists, which JSON takes sooner than small arrays."""
    if isinstance(values, list) and not values:
        return []
    rounded: list[Any] = np.asarray(values, dtype=np.float64).round(_DIGITS).tolist()
    return rounded
