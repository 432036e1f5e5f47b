"""Checks of the rows of the fault matrix about what breaks the certificate's bounds."""

import numpy as np

from companion.supervision.certify import Certified, Flown
from tests.closed_loop.matrix.inprocess import InProcess, run, scenario


def beyond(f, i):
    """All that drone i's companion said of broken bounds."""
    return {text for o in f.companions[i].outs for text in o.beyond}


def believe(*args):
    """A certifier that accepts everything."""
    return Certified(Flown.COMMAND, 0.0, "neighbour")


def row_39_trunk(note):
    """A trunk comes towards the drone at 1.5 m/s, and goes on."""
    trunk = {"x": 24.0, "y": 0.2, "radius": 0.4}
    speed, begin = 1.5, 5.0
    enforced = {"certificate": {"enforce": True}}
    f = InProcess(
        scenario(world={"cylinders": [trunk]}, mission__time_limit=18.0, companion=enforced)
    )
    rows = f.sensors._occluders.cylinders

    def move(t):
        rows[0, 0] = trunk["x"] - speed * max(t - begin, 0.0)

    run(f, {0.02 * k: lambda f, k=k: move(0.02 * k) for k in range(900)})
    truth = f.truth.arrays()
    x = trunk["x"] - speed * np.maximum(truth["t"] - begin, 0.0)
    p = truth["position"][:, 0].astype(float)
    room = np.hypot(p[:, 0] - x, p[:, 1] - trunk["y"]) - trunk["radius"]
    note("least distance to the moving trunk [m]", float(room.min()))
    assert room.min() > 0.2
    assert any("obstacle" in text and "are assumed" in text for text in beyond(f, 0))
