"""Checks of the row of the fault matrix about what flies at the drone; see `checks.py`."""

import numpy as np

from companion.supervision.certify import Certified, Flown
from tests.closed_loop.matrix.inprocess import InProcess, fly, run, scenario

TOUCH = 0.4  # m between two drones
ATTACK = 11.0  # s, when both drones have reached their targets and hover there
STAY = {
    "drones__starts": [[12.0, 0.3], [0.0, 0.0]],
    "mission__targets_of": {"drone1": [[12.0, 0.3, 2.0]], "drone2": [[2.0, 0.0, 2.0]]},
    "mission__targets": [],
    "world": {},
}


def gaps(f, a, b, since):
    """Distances of two drones from `since` [s] on."""
    truth = f.truth.arrays()
    p = truth["position"][truth["t"] > since].astype(float)
    return np.linalg.norm(p[:, a] - p[:, b], axis=1)


def beyond(f, i):
    """All that drone i's companion said of broken bounds."""
    return {text for o in f.companions[i].outs for text in o.beyond}


def believe(*args):
    """A certifier that accepts everything."""
    return Certified(Flown.COMMAND, 0.0, "neighbour")


def attacked(note, speeds=(1.0, 2.0, 3.0, 5.0)):
    """A drone that flies at its neighbour, at 1 to 5 m/s, through the place where it is."""
    for speed in speeds:
        attack = {"kind": "turn_into", "drone": "drone1", "at": ATTACK, "amount": speed}
        f = fly([attack], count=2, mission__time_limit=ATTACK + 10.0 / speed + 3.0, **STAY)
        least = float(gaps(f, 0, 1, 5.0).min())
        note(f"least distance [m], attacked at {speed:g} m/s", least)
        assert least > TOUCH, (speed, least)
        told = [text for text in beyond(f, 1) if "m/s, 3 m/s" in text]
        assert bool(told) == (speed > 4.0), (speed, beyond(f, 1))


def three_of_ten(note):
    """Ten drones change places on a circle; three of them see no neighbour and give no way."""
    data = {
        "drones__formation": "circle",
        "drones__ring": 8.0,
        "drones__heading_deg": "target",
        "mission__exchange": True,
        "mission__targets": [],
        "mission__tolerance": 1.0,
        "mission__time_limit": 24.0,
    }
    f = InProcess(scenario(count=10, world={}, **data))
    for i in (0, 3, 6):
        companion = f.companions[i].companion
        companion._neighbours.update = lambda *a: []
        companion._supervision._certifier.certify = believe
    run(f)
    giving = [i for i in range(10) if i not in (0, 3, 6)]
    pairs = [(a, b) for a in giving for b in range(10) if a != b]
    least = min(float(gaps(f, a, b, 5.0).min()) for a, b in pairs)
    note("least distance [m], three of ten give no way", least)
    assert least > TOUCH


def row_39_trunk(note):
    """A trunk comes towards the drone at 1.5 m/s, and goes on."""
    trunk = {"x": 24.0, "y": 0.2, "radius": 0.4}
    speed, begin = 1.5, 5.0
    f = InProcess(scenario(world={"cylinders": [trunk]}, mission__time_limit=18.0))
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
