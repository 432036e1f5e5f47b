"""Checks of the fault matrix: a camera that is not as configured, in real pictures."""

import numpy as np

from companion.perception.camera_health import CameraFault
from tests.closed_loop.matrix.inprocess import fly
from tests.closed_loop.matrix.measures import mode_after, seconds_until

TURNS = 5.0  # s, when the look round before setting out begins
AMONG_TRUNKS = {
    "cylinders": [{"x": x, "y": y, "radius": 0.6} for x in (5.0, 9.0) for y in (-3.0, 0.3, 4.0)]
}
PIXELS = {
    "sensing__neighbours": "camera",
    "sensing__obstacles": "camera",
    "sensing__width": 640,
    "sensing__height": 400,
    "world": AMONG_TRUNKS,
    "companion": {},
}
MISMOUNTED = ("camera_mirrored", "camera_upside_down", "camera_rolled", "camera_scaled")


def begins_to_turn(companion):
    """Return when the drone begins to look round [s]; when it should, where it does not."""
    turning = (t for t, o in companion.ticks(0.0) if o.own and abs(o.own.omega[2]) > 0.3)
    return next(turning, TURNS)


def row_32(note):
    """Noticed as soon as the drone turns, before it sets out: it stays, and holds."""
    slowest = -np.inf
    for kind in MISMOUNTED:
        f = fly([{"kind": kind}], mission__time_limit=13.0, **PIXELS)
        noticed = next(t for t, o in f.companions[0].ticks(0.0) if o.fault is not CameraFault.NONE)
        # Upside down, sky and ground are where they cannot be: such a picture is unclear already.
        unclear = kind == "camera_upside_down"
        expected = CameraFault.UNCLEAR if unclear else CameraFault.MISALIGNED
        assert f.companions[0].at(noticed).fault is expected, kind
        turns = begins_to_turn(f.companions[0])
        assert noticed < turns + 2.0, (kind, noticed, turns)
        rest = seconds_until(f, noticed, lambda v, p: np.linalg.norm(v) <= 0.2)
        assert rest <= 2.0, (kind, rest)
        way = f.truth.arrays()
        level = way["position"][way["t"] >= noticed, 0, :2]  # one is noticed while it still climbs
        assert np.linalg.norm(level - level[0], axis=1).max() < 0.4, kind
        assert mode_after(f, noticed, "HOLD") < 5.3, kind
        f.check_always()
        slowest = max(slowest, noticed - turns)
    note("noticed after the drone begins to turn", slowest)


def row_32_late(note):
    """Stamps 0.1 s off are corrected: the flight goes on as with right ones."""
    for amount in (-0.1, 0.1):
        f = fly([{"kind": "camera_misdated", "amount": amount}], mission__time_limit=14.0, **PIXELS)
        lag = f.companions[0].outs[-1].alignment.lag
        assert abs(lag - amount) < 0.02, (amount, lag)
        assert f.moved(0, TURNS) > 5.0
        f.check_always()
        note(f"s found of {amount:+g} s", lag)
