"""Flights of the fault matrix in the paper's forest.

One flight shows several rows, on different drones: a fault affects its own drone alone, the others
see at most a neighbour that stops, lands or falls. Where a row has several kinds of faults, the
seed selects one.
"""

import json
from functools import lru_cache

import numpy as np

from sitl_sim.figures.metrics import reached_in_order
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.worlds.world import surface_distance
from tests.closed_loop.matrix import forest_rows, forest_rows_from_26
from tests.closed_loop.matrix.inprocess import AUTOPILOT, SET_OUT_AT_ONCE, WithPictures, run

TARGETS = [[-3.5, -10.5, 2.0], [-10.5, -3.5, 2.0], [3.5, 17.5, 2.0]]
ROWS = forest_rows.ROWS | forest_rows_from_26.ROWS

# Flights of three drones, by seed. Rows by drone; the first is clean, unless all are struck.
THREE = [
    [None, "1", "3"], [None, "2", "4"], [None, "5", "6"], [None, "7", "9"],
    [None, "7_silence", "10"], [None, "8", "15"], [None, "13", "16"], [None, "14", "19"],
    [None, "17", "9"], [None, "22_battery", "21"], [None, "24", "22"], [None, "25", "3"],
    ["9_half"] * 3, ["18"] * 3,
    ["26", "27", "30"], ["28", "29", "31"], ["33", "34", "41"], ["35"] * 3, ["36"] * 3, ["37"] * 3,
    ["39", None, None], ["40"] * 3,
]  # fmt: skip
# Flights of nine.
NINE = [
    ["1", "2", "7", "8", "24"],
    ["5", "7_silence", "13", "14", "25"],
    ["17", "17", "17", "22_battery"],
    ["3", "4", "6", "15", "16", "19", "21", "22", "15"],
    ["9", "9", "9", "9", "10", "10", "18", "18", "18"],
    ["9_half"] * 9,
]


class Forest(WithPictures):
    """A flight in the forest with rows that strike: [(row's name, drone, kind)]."""

    def __init__(self, scenario, strikes):
        self.strikes, self.fences = strikes, {}
        super().__init__(scenario)
        lost = {i for row, i, _ in strikes if ROWS[row].lost}
        self.healthy = [i for i in range(len(self.names)) if i not in lost]

    def fly(self):
        at = {}
        for row, i, kind in self.strikes:
            for t, call in (ROWS[row].strike(self, i, kind) or {}).items():
                at.setdefault(t, []).append(call)
        run(self, {t: lambda f, calls=calls: [c() for c in calls] for t, calls in at.items()})
        self._reached = self.figures()["targets_reached"]
        return self

    def undisturbed(self):
        """Where three drones are without any fault, (T, 3, 3) [m]."""
        return plain(self.scenario.seed)

    def reached(self, i):
        return int(self._reached[self.names[i]].split("/")[0])

    def first_target(self, i):
        """Flight time [s] at which drone i reaches its first target."""
        truth, world = self.truth.arrays(), self.world
        targets = world["targets"][self.names[i]]
        at = reached_in_order(truth["position"][:, i], targets, world["target_tolerance"])
        return float(truth["t"][at[0]])

    def room(self, i):
        """Least distance [m] of drone i's centre from a surface, once it is up."""
        p = self.truth.arrays()["position"][:, i].astype(float)
        return float(surface_distance(p[p[:, 2] > 0.3], self.world).min())

    def least_distance(self, i, k, since, until=np.inf):
        """Of two drones that are both up [m], between two flight times [s]."""
        truth = self.truth.arrays()
        p = truth["position"][(truth["t"] >= since) & (truth["t"] <= until)]
        up = (p[:, i, 2] > 0.3) & (p[:, k, 2] > 0.3)
        return float(np.linalg.norm(p[:, i] - p[:, k], axis=1)[up].min())


def scenario(drones, seed, seconds, parameters, faults, options):
    """The forest of this seed; perfect detectors, which nothing here is about."""
    return scenarios.load(
        "forest",
        [
            f"drones.count={drones}",
            f"seed={seed}",
            f"mission.time_limit={seconds}",
            "sensing.neighbours=truth",
            "sensing.obstacles=map",
            f"mission.targets={TARGETS}",
            "mission.home=false",
            f"drones.parameters={json.dumps(parameters)}",
            f"faults={json.dumps(faults)}",
            f"companion={json.dumps(SET_OUT_AT_ONCE)}",
            *(f"{key}={json.dumps(value)}" for key, value in options.items()),
        ],
    )


def forest_flight(drones, seed, seconds, strikes):
    """Fly with these strikes: [(row's name, drone, kind)]."""
    faults = [
        fault | {"drone": f"drone{i + 1}"}
        for row, i, kind in strikes
        for fault in ROWS[row].faults[kind]
    ]
    options = {k: v for row, _, kind in strikes for k, v in ROWS[row].options[kind].items()}
    parameters = AUTOPILOT | {
        k: v for row, _, _ in strikes for k, v in ROWS[row].parameters.items()
    }
    return Forest(scenario(drones, seed, seconds, parameters, faults, options), strikes).fly()


@lru_cache(1)  # tests of one flight come one after another
def flown(drones, number, seed):
    """The flight of THREE or NINE with this number."""
    rows, seconds = (THREE[number], 30.0) if drones == 3 else (NINE[number], 40.0)
    strikes = [
        (row, i, (seed + rows[:i].count(row)) % len(ROWS[row].faults))
        for i, row in enumerate(rows)
        if row is not None
    ]
    return forest_flight(drones, seed, seconds, strikes)


@lru_cache(None)
def plain(seed):
    """Where three drones are without any fault."""
    return forest_flight(3, seed, 30.0, []).truth.arrays()["position"]
