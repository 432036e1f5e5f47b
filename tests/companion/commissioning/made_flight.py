"""A commissioning flight made up from numbers: its telemetry, its corners and its ticks."""

import itertools

import numpy as np

from companion.commissioning.attitude_curve import AttitudeCurve
from companion.commissioning.flight import CommissioningFlight
from companion.perception.camera import Camera
from companion.perception.corner_pairs import CornerPairs
from companion.settings.config import CompanionConfig
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import (
    conjugate,
    multiply,
    quaternion_from_euler,
    rotation_matrix,
    rotation_vector,
)
from mavlink_bridge.wire.messages import Attitude

CAMERA = Camera.equidistant(640, 400)
SECONDS, DT = 30.0, 0.01
DELAY, TELEMETRY, TICK = 0.05, 0.02, 0.1  # s


def made_flight(
    mount=(0.0, 0.0, 0.0),
    lag=0.0,
    focal=1.0,
    hover=0.33,
    drag=0.2,
    swings=(0.15, 0.12, 0.8),
    heave=0.15,
    mirrored=False,
    moved=None,
    noise=0.3,
    seed=0,
):
    """Return a flight of a drone that is as the keywords say, and is configured as one that is not.

    swings: rad, of roll, pitch and yaw. heave: share of g. moved: mount from the middle on; None:
    it stays. noise: px of 320 px.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, DT)
    phases = rng.uniform(0.0, 2.0 * np.pi, 4)
    rates = 2.0 * np.pi * np.array([0.55, 0.7, 0.3, 0.4])
    roll, pitch, yaw, more = np.sin(rates[:, None] * t + phases[:, None])
    q = [
        quaternion_from_euler(swings[0] * a, swings[1] * b, swings[2] * c)
        for a, b, c in zip(roll, pitch, yaw, strict=True)
    ]
    c = GRAVITY * (1.0 + heave * more)
    p, v = _moved(np.array([rotation_matrix(x)[:, 2] for x in q]), c, drag)
    attitudes = _attitudes(t, q)
    states = np.column_stack([t, p, v])[::5]
    config = CompanionConfig.model_validate(
        {"mission": {"commission": True}, "log": {"path": "flight.mcap"}}
    )
    pairs = list(_pairs(t, q, p, rng, mount, moved or mount, lag, focal, mirrored, noise))
    ticks = list(_ticks(t, q, v, c * hover / GRAVITY))
    return CommissioningFlight(config, CAMERA, AttitudeCurve(attitudes), states, pairs, ticks)


def _moved(axes, c, drag):
    """Return places and velocities (n,3) under the lift along the axes, and drag along ground."""
    lift = axes * c[:, None] - [0.0, 0.0, GRAVITY]
    # A pilot keeps it from drifting off: what acts on the mean is taken out.
    lift -= lift.mean(axis=0) * [0.0, 0.0, 1.0]
    p, v = np.zeros_like(lift), np.zeros_like(lift)
    for k in range(1, len(lift)):
        a = lift[k - 1] - drag * np.array([1.0, 1.0, 0.0]) * v[k - 1]
        v[k] = v[k - 1] + DT * a
        p[k] = p[k - 1] + DT * v[k]
    return p + np.array([0.0, 0.0, 3.0 - p[:, 2].min()]), v


def _attitudes(t, q):
    every = round(TELEMETRY / DT)
    return [
        Attitude(t[k], q[k], rotation_vector(multiply(conjugate(q[k - 1]), q[k + 1])) / (2.0 * DT))
        for k in range(every, len(t) - 1, every)
    ]


def _pairs(t, q, p, rng, mount, later, lag, focal, mirrored, noise):
    """Yield what the camera sees of points around, from picture to picture."""
    angles, far = rng.uniform(0.0, 2.0 * np.pi, 400), rng.uniform(4.0, 25.0, 400)
    points = np.stack([far * np.cos(angles), far * np.sin(angles), rng.uniform(0, 6, 400)], axis=1)
    lens = Camera.equidistant(640, 400, 160.0 / focal)
    times = np.arange(1.0, SECONDS - 1.0, TICK)
    for before, after in itertools.pairwise(times):
        seen = []
        for time in (before, after):
            k = round(time / DT)
            turned = lens.turned(mount if time < SECONDS / 2.0 else later)
            body = (points - p[k]) @ rotation_matrix(q[k])
            pixels = turned.project(body @ rotation_matrix(turned.mount))
            pixels += 2.0 * noise * rng.standard_normal(pixels.shape)
            if mirrored:
                pixels[:, 0] = 639.0 - pixels[:, 0]
            inside = ((pixels > 0) & (pixels < [639, 399])).all(axis=1)
            seen.append(np.where(inside[:, None], pixels, np.nan))
        both = np.hstack(seen)
        both = both[np.isfinite(both).all(axis=1)][:40].astype(np.float32)
        yield CornerPairs(before + lag, after + lag, both)


def _ticks(t, q, v, thrust):
    """Yield the records of ticks whose commands act `DELAY` later."""
    every, ahead = round(TICK / DT), round(DELAY / DT)
    for k in range(every, len(t) - every - ahead, every):
        # Held until the next tick: the mean of what acted meanwhile.
        u = thrust[k + ahead : k + ahead + every].mean()
        yield {
            "time": t[k],
            "phase": "fly",
            "own": {"v": v[k].tolist(), "omega": _rate(q, k).tolist()},
            "command": {"c": GRAVITY * u / 0.33},
            "hover_thrust": 0.33,
            "hover": {"exponent": 1.0},
            "delay": [0.05, 0.003],
        }


def _rate(q, k):
    return rotation_vector(multiply(conjugate(q[k - 1]), q[k + 1])) / (2.0 * DT)
