"""How well bare drones are known from pictures of a look, along recorded flights.

    python tests/benchmarks/track_pictures.py RUN... [--looks LOOK,...] [--seed S]
        [--seconds T] [--set KEY=VALUE]

RUN: a run folder with `truth.npz`. The bench renders anew what three of its drones would have seen
in each look, ten times a second, and hands it to network and tracker as in flight; trunks hide as
in truth. It counts drones in view, not behind a trunk.

tracked: share of those to 3 m and to 6 m of which a track is within 0.4 m and 15 % of their range.
ghosts: tracks to 6 m without a drone, in each picture: farther than 0.5 m and 20 % of the range, or
1.5 m more where the track has not been seen for 0.3 s. near: those to 3 m.
"""

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.config import CameraConfig, SensingConfig
from companion.perception.frontend import Detections
from companion.perception.network_neighbours import NetworkNeighbours
from companion.perception.network_search import NetworkSearch
from companion.perception.view import View, load_camera
from mavlink_bridge.wire.messages import VehicleState
from sitl_sim.scenarios.scenario import load
from sitl_sim.scenarios.sensing import lens_of
from sitl_sim.sensors import perfect_detector
from sitl_sim.sensors.renderers import make_renderer
from sitl_sim.worlds.world import Occluders

FROM, TICK = 6.0, 0.1  # s of the flight, from one picture to the next
NEAR, FAR = 3.0, 6.0  # m
LATELY = 0.5  # s unseen, up to which a neighbour is looked for where it must be, as in flight


class Flight:
    """A recorded flight, at its pictures."""

    def __init__(self, folder, seconds):
        truth = np.load(folder / "truth.npz")
        self.world = json.loads((folder / "world.json").read_text(encoding="utf-8"))
        self.t, self.p, self.v = truth["t"], truth["position"], truth["velocity"]
        self.q = truth["attitude"]
        step = round(TICK / float(np.median(np.diff(self.t))))
        first = round(FROM / TICK) * step
        self.frames = range(first, min(first + round(seconds / TICK) * step, len(self.t)), step)
        self.occluders = Occluders(self.world)

    def hidden(self, p, places, _beside=0.0):
        """Whether trunks hide places (n,3) m from p (3,), as `KnownObstacles.hidden` has it."""
        return ~self.occluders.free(p, places) if len(places) else np.zeros(0, bool)

    def state(self, k, me):
        return VehicleState(
            float(self.t[k]), self.p[k, me], self.v[k, me], self.q[k, me], np.zeros(3)
        )


class Observer:
    """One drone's network and tracker."""

    def __init__(self, flight, me, renderer, settings):
        self._f, self._me, self._renderer = flight, me, renderer
        camera = load_camera(CameraConfig())
        self._view = View(camera, needs_foot=False)
        sensing = SensingConfig(detector="network", network=settings["network"])
        self._eyes = NetworkNeighbours(self._view, NetworkSearch(camera, sensing))
        self._neighbours = NeighbourEstimator(self._view, TrackerConfig(**settings["tracker"]))
        self._tracks, self._tracked = [], 0.0
        self._others = [n for n in range(flight.p.shape[1]) if n != me]

    def look(self, k):
        """Take in the picture of frame k; return tracks, offsets of the others, who is in view."""
        f, view = self._f, self._view
        own, others = f.state(k, self._me), self._others
        seed = 64 * k + self._me
        image = self._renderer.render(
            own.p, own.q_wb, f.p[k, others], f.q[k, others], seed, drones_id=others
        )
        lately = [t for t in self._tracks if t.unseen < LATELY]
        seen, _ = self._eyes.find(image, own, lately, self._tracked, due=True)
        looked = Detections(own.time, own, seen)
        self._tracks = self._neighbours.update(own.time, looked, f)
        self._tracked = own.time
        half = view.half_view
        away = f.p[k, others] - own.p
        rays = perfect_detector.camera_rays(own.q_wb, away)
        inside = perfect_detector.seen(rays, half, half * view.camera.height / view.camera.width)
        inside &= ~f.hidden(own.p, f.p[k, others])
        return self._tracks, away, inside


def counted(tracks, own, away, inside):
    """Return the counts of one picture: drones, tracked ones, and tracks without a drone."""
    out = Counter(pictures=1)
    places = np.array([t.p - own for t in tracks]).reshape(-1, 3)
    for offset in away[inside]:
        distance = np.linalg.norm(offset)
        off = np.linalg.norm(places - offset, axis=1)
        right = bool((off < 0.4 + 0.15 * distance).any())
        for name, most in (("near", NEAR), ("far", FAR)):
            out[name] += distance < most
            out[name, "tracked"] += right and distance < most
    for track, place in zip(tracks, places, strict=True):
        distance = np.linalg.norm(place)
        gap = np.linalg.norm(away - place, axis=1).min()
        ghost = gap > 0.5 + 0.2 * distance + (1.5 if track.unseen > 0.3 else 0.0)
        out["ghosts"] += ghost and distance < FAR
        out["near ghosts"] += ghost and distance < NEAR
    return out


def measured(folder, look, seed, seconds, settings):
    """Counts of three drones of a flight in one look."""
    flight, out = Flight(folder, seconds), Counter()
    lens = lens_of(load("crossing", []).sensing)
    renderer = make_renderer(flight.world, look, "bare", seed, lens)
    count = flight.p.shape[1]
    for me in sorted({0, count // 3, 2 * count // 3}):
        observer = Observer(flight, me, renderer, settings)
        for k in flight.frames:
            tracks, away, inside = observer.look(k)
            out += counted(tracks, flight.p[k, me], away, inside)
    return out


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--looks", default="random")
    parser.add_argument("--seed", type=int, default=0, help="of the first flight's looks")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each flight (30)")
    parser.add_argument("--set", action="append", default=[], help="tracker. or network.KEY=VALUE")
    options = parser.parse_args()
    settings = {"tracker": {}, "network": {}}
    for text in options.set:
        key, _, value = text.partition("=")
        part, _, name = key.partition(".")
        settings[part][name] = float(value)
    print("| flight | look | tracked to 3 m | to 6 m | ghosts | near |")
    print("|---|---|---|---|---|---|")
    total = Counter()
    for number, folder in enumerate(options.runs):
        for look in options.looks.split(","):
            found = measured(folder, look, options.seed + number, options.seconds, settings)
            total += found
            print(_row(folder.name, look, found), flush=True)
    print(_row("all", "", total))


def _row(flight, look, n):
    shares = [n[band, "tracked"] / max(n[band], 1) for band in ("near", "far")]
    each = n["ghosts"] / n["pictures"], n["near ghosts"] / n["pictures"]
    cells = [flight, look, *(f"{share:.2f}" for share in (*shares, *each))]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
