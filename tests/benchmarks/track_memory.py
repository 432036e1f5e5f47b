"""How well the tracker knows neighbours in sight and out of it, on recorded flights.

    python tests/benchmarks/track_memory.py RUN... [--set tracker.KEY=VALUE]

RUN: a run folder with `truth.npz`. Every companion of it looks at where the others were, ten times
a second: its looks are drawn by noise of the size that the eyes have, with misses and ghosts, and
trunks hide nothing. Its tracks are compared with the truth, by how long a neighbour was out of
view. Counted are neighbours within 6 m that were tracked once; foreign drones by themselves.

kept: share that still has a track. error: m, rms. sigma: m, rms along an axis, that the track
tells. NEES: squared error over what the track tells of it, 1 where that is right.
"""

import argparse
import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.neighbours import in_plain_view
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.config import CameraConfig
from companion.perception.view import View, load_camera
from companion.types import Detection
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

BANDS = (0.0, 0.05, 0.55, 1.05, 1.55, 2.05, 2.55, 3.05, 4.05)  # s out of view, each from
FROM, TICK, LATE = 8.0, 0.1, 0.06  # s: of the flight, of a tick, age of a picture
SEEN_TO, COUNTS_TO = 7.0, 6.0  # m
MISSES, GHOSTS = 0.1, 0.03
BEARING, RANGE = 0.006, 0.03  # rad; share of the range
SAME = 1.0  # m between a track and the neighbour that it is, when it is seen


class Flight:
    """The truth of one recorded flight, at the ticks of its companions."""

    def __init__(self, folder):
        truth = np.load(folder / "truth.npz")
        world = json.loads((folder / "world.json").read_text(encoding="utf-8"))
        names = [str(name) for name in truth["names"]]
        self.foreign = {names.index(name) for name in world.get("foreign") or ()}
        self.t, self.p, self.v = truth["t"], truth["position"], truth["velocity"]
        self.q = truth["attitude"]
        step = float(np.median(np.diff(self.t)))
        self.late = round(LATE / step)
        self.ticks = range(round(FROM / step), len(self.t), max(round(TICK / step), 1))


class Observer:
    """One companion's looks and tracks."""

    def __init__(self, flight, me, config, view, rng):
        self._f, self._me, self._view, self._rng = flight, me, view, rng
        self._tracker = Tracker(config)
        self._is = {}  # neighbour by track
        self._shown = {}  # s, when each was last in view
        self._known = set()

    def tick(self, k):
        """Look, track; return (neighbour, s out of view, its track or None)."""
        f, c = self._f, k - self._f.late
        self._look(c)
        self._tracker.predict(float(f.t[k]))
        tracks = self._tracker.tracks()
        for track in tracks:
            if track.unseen < f.t[k] - f.t[c] + 1e-6:
                away = np.linalg.norm(f.p[k] - track.p, axis=1)
                away[self._me] = np.inf
                nearest = int(away.argmin())
                self._is.pop(track.id, None)
                if away[nearest] < SAME:
                    self._is[track.id] = nearest
                    self._known.add(nearest)
        newest = {}
        for track in sorted(tracks, key=lambda t: -t.unseen):
            newest[self._is.get(track.id)] = track
        for other in self._known:
            if np.linalg.norm(f.p[k, other] - f.p[k, self._me]) < COUNTS_TO:
                unseen = f.t[k] - self._shown[other]
                yield other, unseen if unseen > f.t[k] - f.t[c] + 1e-6 else 0.0, newest.get(other)

    def _look(self, c):
        f, rng, me = self._f, self._rng, self._me
        state = VehicleState(float(f.t[c]), f.p[c, me], f.v[c, me], f.q[c, me], np.zeros(3))
        away = np.linalg.norm(f.p[c] - state.p, axis=1)
        shown = np.array(self._view.shows(state, f.p[c], margin=0.0)) & (away < SEEN_TO)
        shown[me] = False
        self._shown |= dict.fromkeys(np.flatnonzero(shown).tolist(), float(f.t[c]))
        places = [f.p[c, n] for n in np.flatnonzero(shown) if rng.random() > MISSES]
        turn = (rotation_matrix(state.q_wb) @ rotation_matrix(self._view.mount)).T
        rays = [turn @ (p - state.p) for p in places]
        if rng.random() < GHOSTS:
            ghost = rng.normal(size=3) * [4.0, 1.0, 4.0]
            rays += [ghost] if ghost[2] > 0.0 else []
        seen = []
        for ray in rays:
            size = float(np.linalg.norm(ray))
            ray = ray / size + rng.normal(0.0, BEARING, 3)
            size *= 1.0 + rng.normal(0.0, RANGE)
            seen.append(Detection(ray / np.linalg.norm(ray), size, BEARING, RANGE * size))
        self._tracker.predict(state.time)
        in_view = in_plain_view(self._view, state, self._tracker, KnownObstacles())
        self._tracker.update(state.time, seen, state, self._view.mount, in_view)


def compared(folders, config):
    """Rows (kept, squared error, variance along an axis, NEES) by (whose, band)."""
    view = View(load_camera(CameraConfig()), needs_foot=False)
    rows = defaultdict(list)
    for number, folder in enumerate(folders):
        flight = Flight(folder)
        rng = np.random.default_rng(number)
        for me in sorted(set(range(flight.p.shape[1])) - flight.foreign):
            observer = Observer(flight, me, config, view, rng)
            for k in flight.ticks:
                for other, unseen, track in observer.tick(k):
                    whose = "foreign" if other in flight.foreign else "own"
                    band = int(np.searchsorted(BANDS, unseen, side="right")) - 1
                    rows[whose, band].append(_row(track, flight.p[k, other]))
    return rows


def _row(track, p):
    if track is None:
        return False, np.nan, np.nan, np.nan
    off, covariance = track.p - p, track.P[:3, :3]
    nees = float(off @ np.linalg.solve(covariance, off)) / 3.0
    return True, float(off @ off), float(np.trace(covariance)) / 3.0, nees


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="tracker.KEY=VALUE")
    options = parser.parse_args()
    given = dict(text.removeprefix("tracker.").split("=", 1) for text in options.set)
    rows = compared(options.runs, TrackerConfig(**{k: float(v) for k, v in given.items()}))
    print("| neighbours | out of view | n | kept | error | sigma | NEES |")
    print("|---|---|---|---|---|---|---|")
    for whose, band in sorted(rows, key=lambda key: (key[0] != "own", key[1])):
        kept, error, sigma, nees = np.array(rows[whose, band], float).T
        over = f"{BANDS[band]:g}" + (
            f" to {BANDS[band + 1]:g} s" if band + 1 < len(BANDS) else " s"
        )
        print(
            f"| {whose} | {over} | {len(kept)} | {kept.mean():.1%} | {_rms(error):.2f} m | "
            f"{_rms(sigma):.2f} m | {np.nanmean(nees):.1f} |"
        )


def _rms(squares):
    return float(np.sqrt(np.nanmean(squares)))


if __name__ == "__main__":
    main()
