"""Checks of the rows of the fault matrix about what breaks the certificate's bounds."""

import numpy as np

from companion.supervision.certify import Certified, Flown
from tests.closed_loop.matrix.inprocess import SET_OUT_AT_ONCE, InProcess, fly, run, scenario

_FAST = "3 m/s are assumed"


def beyond(f, i):
    """All that drone i's companion said of broken bounds."""
    return {text for o in f.companions[i].outs for text in o.beyond}


def believe(*args):
    """A certifier that accepts everything."""
    return Certified(Flown.COMMAND, 0.0, "neighbour")


def row_39_attack(note):
    """A drone flies at ours: at 1 m/s it is evaded; at 5 m/s its speed is named before it hits.

    Whoever is three times as fast and turns at will meets whom it wants: no evasion avoids that.
    """
    for speed in (1.0, 5.0):
        f = fly(
            count=2,
            world={},
            mission__targets=[[0.0, -20.0, 2.0], [0.0, 0.0, 2.0]],
            mission__time_limit=26.0,
            drones__spacing=14.0,
            drones__foreign={"drone2": {"does": "pursue", "speed": speed, "after": 6.0}},
            companion=SET_OUT_AT_ONCE,
        )
        truth = f.truth.arrays()
        p = truth["position"].astype(float)
        apart = np.linalg.norm(p[:, 0] - p[:, 1], axis=1)
        apart[(p[..., 2] < 0.3).any(axis=1)] = np.inf
        met = truth["t"][apart < 2 * f.scenario.drones.radius]
        if speed == 1.0:
            assert not len(met), apart.min()
            note("least distance to a pursuer at 1 m/s [m]", float(apart.min()))
            continue
        said = next(t for t, o in f.companions[0].ticks(0.0) if any(_FAST in b for b in o.beyond))
        assert said < met[0] - 0.5
        note("least s from naming a pursuer's 5 m/s to its hit", float(met[0] - said))


def row_39_trunk(note):
    """A trunk comes towards the drone, and goes on: a little aside of its course, or along it."""
    for aside, speed in ((0.2, 1.5), (0.0, 1.5), (0.0, 2.0)):
        room, f = _moving_trunk(aside, speed)
        note(f"least distance to a trunk at {speed:g} m/s, {aside:g} m aside [m]", room)
        assert room > 0.2, (aside, speed, room)
        assert any("obstacle" in text and "are assumed" in text for text in beyond(f, 0))


def _moving_trunk(aside, speed, start=24.0, begin=5.0, radius=0.4):
    """Return the least distance [m] between the drone's centre and a trunk's bark, and the flight.

    aside: m, of the trunk from the drone's course. speed: m/s, from `begin` [s] on.
    """
    f = InProcess(
        scenario(
            world={"cylinders": [{"x": start, "y": aside, "radius": radius}]},
            mission__time_limit=18.0,
            companion={},
        )
    )
    rows = f.sensors._occluders.cylinders

    def move(t):
        rows[0, 0] = start - speed * max(t - begin, 0.0)

    run(f, {0.02 * k: lambda f, k=k: move(0.02 * k) for k in range(900)})
    truth = f.truth.arrays()
    x = start - speed * np.maximum(truth["t"] - begin, 0.0)
    p = truth["position"][:, 0].astype(float)
    return float((np.hypot(p[:, 0] - x, p[:, 1] - aside) - radius).min()), f
