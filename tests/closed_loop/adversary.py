"""A drone among adversaries: does a certified drone that moves ever touch anything?

One drone flies by a planner that looks at nothing, neighbours or trunks: to random goals at full
speed, or by random commands. All that keeps it clear is the certificate. Its body and rate loops
are the simulator's; its eyes miss, report ghosts and are late; there is wind. Four neighbours
cruise, swerve, stop and attack as they like within the certificate's bounds: their acceleration and
speed are limited, and one that the drone cannot see stays away.

    python -m tests.closed_loop.adversary --ticks 100000 --seed 1
    python -m tests.closed_loop.adversary --brake 150 --seed 1    # how well a way is flown
"""

import argparse
import json
import time
from collections import Counter, deque

import numpy as np
from numba import njit

from companion.estimation.delay import Delay, within_doubt
from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.neighbours import in_plain_view
from companion.estimation.prediction import StatePredictor
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.guidance.fence import FenceConfig
from companion.perception.config import CameraConfig
from companion.perception.frontend import Detections
from companion.perception.view import View, load_camera
from companion.supervision.braking import brake
from companion.supervision.certify import CertificateConfig, Certifier, Flown, braking_law
from companion.supervision.evasion import STEPS, STRAIGHT, simulate
from companion.supervision.guard_config import GuardConfig
from companion.supervision.surroundings import SurroundingsEstimator
from companion.types import Detection, Phase
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import RateCommand, VehicleState
from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.rates import make_rate_loop, rate_loop
from sitl_sim.vehicles.rigid_body import SUBSTEP, Vehicles, step_one

TICK, TO_EFFECT, DELAY = 0.1, 0.02, 0.046  # s; the delay as it is measured in flight
KNOWN = Delay(DELAY, 0.004)
CONTACT, RADIUS = 0.4, 0.2  # m
MOVING = 0.3  # m/s, when the command is checked; as in the metrics
NEIGHBOURS, TRUNKS = 4, 3
MISSES, GHOSTS, LATE = 0.2, 0.05, 0.1  # shares; s
BEHAVIOURS = ("cruise", "swerve", "stop", "attack")
EPISODE = 200  # ticks
FAST = 1.3  # m/s from which a way to stop is flown to measure it
SEEN = 1.5  # s in view before a contact, for the neighbour to count as seen


@njit(cache=True)
def _fly(state, body, loop, omega, thrust, wind, count):
    for _ in range(count):
        rate_loop(0, loop, omega, thrust, state.omega[0], SUBSTEP)
        step_one(0, state, body, loop.command, wind, SUBSTEP)


class Neighbours:
    """Points that accelerate within the bounds, by a behaviour that changes now and then."""

    def __init__(self, rng, config):
        self._rng, self._config = rng, config
        angle = rng.uniform(-np.pi, np.pi, NEIGHBOURS)
        away = rng.uniform(2.5, 6.0, NEIGHBOURS)
        level = rng.uniform(1.6, 2.4, NEIGHBOURS)
        self.p = np.column_stack([away * np.cos(angle), away * np.sin(angle), level])
        self.v = rng.normal(0.0, 0.7, (NEIGHBOURS, 3)) * [1.0, 1.0, 0.2]
        self.seen = np.full(NEIGHBOURS, 0.0)  # s in view without a break
        self._change()

    def _change(self):
        self.kinds = self._rng.integers(len(BEHAVIOURS), size=NEIGHBOURS)
        self._push = self._rng.normal(size=(NEIGHBOURS, 3)) * [1.0, 1.0, 0.3]

    def move(self, p, v, shown, dt):
        """Move for dt [s] among others; p, v: of the drone; shown (n,): which it can see."""
        if self._rng.random() < 0.07:
            self._change()
        self.seen = np.where(shown, self.seen + dt, 0.0)
        bound = self._config.neighbour_acceleration
        ahead = p + 0.5 * v - self.p - 0.3 * self.v
        wanted = np.zeros_like(self.v)
        for n, kind in enumerate(self.kinds):
            if BEHAVIOURS[kind] == "swerve":
                wanted[n] = self._push[n]
            elif BEHAVIOURS[kind] == "stop":
                wanted[n] = -3.0 * self.v[n] / bound
            elif BEHAVIOURS[kind] == "attack":
                wanted[n] = ahead[n]
            if not shown[n]:
                wanted[n] = self._unseen(p - self.p[n], self.v[n], wanted[n])
        size = np.maximum(np.linalg.norm(wanted, axis=1, keepdims=True), 1.0)
        self.v = self.v + dt * bound * wanted / size
        speed = np.linalg.norm(self.v, axis=1, keepdims=True)
        self.v *= np.minimum(1.0, 0.8 * self._config.neighbour_speed / np.maximum(speed, 1e-9))
        self.p = self.p + dt * self.v

    def _unseen(self, off, v, wanted):
        """Return what one out of the drone's sight wants: it stops coming nearer, and keeps away.

        off, v (3,): to the drone, m; own velocity, m/s.
        """
        closing = v @ off / np.linalg.norm(off)
        if closing > self._config.unseen_speed:
            return -3.0 * closing * off
        return -off if np.linalg.norm(off) < 4.0 else wanted


class Episode:
    """One drone, its neighbours and trunks, from a start at rest."""

    def __init__(self, seed, config, guard, view, alone=False):
        """alone: neighbours and trunks are far away."""
        self.rng = np.random.default_rng(seed)
        self._config, self._guard, self._view = config, guard, view
        self.vehicles = Vehicles(Airframe(), [[0.0, 0.0, 2.0]], self.rng.uniform(-3.0, 3.0))
        self._hover = np.sqrt(1.0 / 3.0)
        self.vehicles.state.motor[:] = self._hover
        self._loop = make_rate_loop([RateGains()], [Airframe()])
        self.others = Neighbours(self.rng, config)
        angle, away = self.rng.uniform(-3, 3, TRUNKS), self.rng.uniform(2.0, 6.0, TRUNKS)
        if alone:
            self.others.p += 1e3
            away += 1e3
        radius = self.rng.uniform(0.15, 0.8, TRUNKS)
        self.trunks = np.column_stack(
            [(away + radius) * np.cos(angle), (away + radius) * np.sin(angle), radius]
        )
        noise = self.rng.normal(0.0, 0.02, (TRUNKS, 3)) * [1.0, 1.0, 0.5]
        self._known = KnownObstacles(
            self.trunks + noise, occluders=self.trunks, sigmas=np.full(TRUNKS, 0.03)
        )
        self._wind = self.rng.normal(0.0, 1.5, 3) * [1.0, 1.0, 0.2]
        self._gust = np.zeros(3)
        self._history = InputHistory(DELAY)
        self._predictor = StatePredictor(self._history)
        self._tracker = Tracker(TrackerConfig())
        self._around = SurroundingsEstimator(config, FenceConfig(), view)
        self._certifier = Certifier(config, guard, RADIUS)
        self._looks = deque()
        self._command = RateCommand(np.zeros(3), 9.80665)
        self._wild = self.rng.random() < 0.3
        self._goal = np.zeros(3)
        self.time, self.looked_round = 10.0, 0
        self.flown = Flown.COMMAND

    # --- what the drone believes ---------------------------------------------------------

    def _own(self):
        s, r = self.vehicles.state, self.rng
        return VehicleState(
            self.time,
            s.p[0] + r.normal(0.0, 0.01, 3),
            s.v[0] + r.normal(0.0, 0.03, 3),
            s.q[0].copy(),
            s.omega[0] + r.normal(0.0, 0.01, 3),
        )

    def _look(self, own):
        """Take a picture; return the one that is ready: detections and the state then."""
        s, r = self.vehicles.state, self.rng
        truth = VehicleState(self.time, s.p[0].copy(), s.v[0], s.q[0].copy(), s.omega[0])
        shown = np.array(self._view.shows(truth, self.others.p, margin=0.0))
        far = np.linalg.norm(self.others.p - truth.p, axis=1)
        hidden = self._known.hidden(truth.p, self.others.p)
        self.shown = shown & (far < 8.0) & ~np.array(hidden)
        places = [p for p, sees in zip(self.others.p, self.shown, strict=True) if sees]
        places = [p for p in places if r.random() > MISSES]
        if r.random() < GHOSTS:
            places.append(truth.p + r.normal(size=3) * [4.0, 4.0, 1.0])
        turn = (rotation_matrix(truth.q_wb) @ rotation_matrix(self._view.mount)).T
        seen = []
        for p in places:
            off = turn @ (p - truth.p)
            size = float(np.linalg.norm(off))
            ray = off / size + r.normal(0.0, 0.005, 3)
            seen.append(
                Detection(ray / np.linalg.norm(ray), size + r.normal(0.0, 0.03), 0.005, 0.03)
            )
        self._looks.append((self.time, own, seen))
        return self._looks.popleft() if len(self._looks) > round(LATE / TICK) else None

    def _track(self, look):
        if look is None:
            return Detections()
        time, own, seen = look
        self._tracker.predict(time)
        in_view = in_plain_view(self._view, own, self._tracker, self._known)
        self._tracker.update(time, seen, own, self._view.mount, in_view)
        return Detections(time, own, seen, started=True)

    def _planned(self, own):
        """Return the command of a planner that looks at nothing, and flies where it looks."""
        r = self.rng
        if self.looked_round < 40:  # turns on the spot first, as a companion does
            self.looked_round += 1
            still = brake(own, self._guard)
            return RateCommand(np.array([*still.omega[:2], 1.6]), still.c)
        if r.random() < 0.03 or np.linalg.norm(self._goal - own.p) < 0.5:
            self._goal = np.array([*r.uniform(-6.0, 6.0, 2), r.uniform(1.5, 2.5)])
        if self._wild and r.random() < 0.5:
            return RateCommand(r.uniform(-1.5, 1.5, 3), float(r.uniform(7.0, 13.0)))
        way = self._goal - own.p
        heading = rotation_matrix(own.q_wb)[:, 0]
        off = np.arctan2(
            heading[0] * way[1] - heading[1] * way[0], heading[0] * way[0] + heading[1] * way[1]
        )
        speed = 1.65 if abs(off) < 0.7 else 0.2
        wanted = speed * way / np.linalg.norm(way)
        faster = VehicleState(own.time, own.p, own.v - wanted, own.q_wb, own.omega)
        to = brake(faster, self._guard)
        return RateCommand(np.array([*to.omega[:2], np.clip(2.0 * off, -1.5, 1.5)]), to.c)

    # --- one tick ------------------------------------------------------------------------

    def tick(self):
        own = self._own()
        seen = self._track(self._look(own))
        self._tracker.predict(self.time)
        tracks = self._tracker.tracks()
        began = time.thread_time()
        around = self._around.update(
            self.time, own, seen, self._known, tracks, np.zeros(3), Phase.FLY
        )
        self.cost = time.thread_time() - began
        prediction = self._predictor.update(own)
        command = self._planned(own)
        began = time.thread_time()
        found = self._certifier.certify(command, prediction, around.scene, KNOWN)
        self.cost += time.thread_time() - began
        self.flown, self.broken = found.flown, around.broken
        accepted = found.flown is Flown.COMMAND
        self.refused = not accepted and found.instead is None  # and flown all the same
        command = command if accepted or self.refused else found.instead
        self._send(command, TICK - TO_EFFECT)
        return self._contacts()

    def brake(self, count):
        """Brake to rest without looking; return how far beside the way [m] and how much faster.

        (count + 1,) each, by ticks.
        """
        beside, faster, way = [], [], None
        for k in range(count + 1):
            ahead = self._predictor.update(self._own())
            flown = simulate(
                ahead.x0, STRAIGHT, ahead.disturbance, braking_law(self._guard, KNOWN), None
            )
            way = way or flown
            self._send(RateCommand(flown.u[0, 1:4], float(flown.u[0, 0])), DELAY - TO_EFFECT)
            state = self.vehicles.state
            beside.append(float(np.linalg.norm(state.p[0] - way.p[0, k])))
            faster.append(float(np.linalg.norm(state.v[0]) - np.linalg.norm(way.v[0, k])))
            self._advance(TICK - DELAY)
        return beside, faster

    def _send(self, command, dt):
        """Send a command, and fly until `dt` [s] after it has arrived."""
        self._advance(TO_EFFECT)
        self._command = RateCommand(within_doubt(command.omega, KNOWN), command.c)
        u = np.array([self._command.c, *self._command.omega])
        self._history.add(SentInput(self.time, u, 0.3))
        self._advance(dt)
        self.time = round(self.time + TICK, 6)

    def _advance(self, dt):
        self._gust += 0.3 * self.rng.normal(size=3) - 0.1 * self._gust
        wind = (self._wind + self._gust)[None]
        thrust = self._command.c * 0.7 / (4 * 5.15)
        state = self.vehicles.state
        _fly(
            state,
            self.vehicles.body,
            self._loop,
            self._command.omega,
            thrust,
            wind,
            round(dt / SUBSTEP),
        )
        self.others.move(state.p[0], state.v[0], self.shown, dt)

    def _contacts(self):
        """Return what the drone touches now, and whether it had been in sight."""
        p = self.vehicles.state.p[0]
        near = np.linalg.norm(self.others.p - p, axis=1)
        n = int(near.argmin())
        if near[n] < CONTACT:
            return "neighbour" if self.others.seen[n] > SEEN else "neighbour from out of view"
        if (np.hypot(*(self.trunks[:, :2] - p[:2]).T) - self.trunks[:, 2]).min() < RADIUS:
            return "trunk"
        return ""


def fly(ticks, seed, config=None, guard=None, costs=None):
    """Fly episodes of this many ticks in all; return counts.

    costs: a list for the processor time [s] that the certificate took at each tick.
    """
    config, guard = config or CertificateConfig(enforce=True), guard or GuardConfig()
    camera = CameraConfig()
    view = View(load_camera(camera), needs_foot=False)
    counts, number = Counter(), 0
    while counts["ticks"] < ticks:
        episode = Episode([seed, number], config, guard, view)
        number += 1
        before = Flown.COMMAND
        for _ in range(EPISODE):
            # A gust that pushes a drone at rest within the tick makes it no mover.
            moves = float(np.linalg.norm(episode.vehicles.state.v[0])) > MOVING
            touched = episode.tick()
            if costs is not None:
                costs.append(episode.cost)
            counts["ticks"] += 1
            counts[f"flown: {episode.flown.value}"] += 1
            counts["refused commands that flew"] += episode.refused
            counts["moving"] += moves
            counts["ticks with a broken bound"] += bool(episode.broken)
            counts["none right after command"] += (
                episode.flown is Flown.NONE and before is Flown.COMMAND
            )
            before = episode.flown
            if touched:
                how = "moving" if moves else "standing"
                certified = "uncertified" if episode.flown is Flown.NONE else "certified"
                counts[f"contact: {how}, {certified}, {touched}"] += 1
                break
    return counts


def braking(count, seed):
    """Print how well `count` ways to stop are flown from cruise, far from all else."""
    config, guard = CertificateConfig(enforce=True), GuardConfig()
    view = View(load_camera(CameraConfig()), needs_foot=False)
    runs = []
    for number in range(count):
        episode = Episode([seed, number], config, guard, view, alone=True)
        while np.linalg.norm(episode.vehicles.state.v[0]) < FAST:
            episode.tick()
        runs.append(episode.brake(STEPS))
    beside, faster = np.array(runs).transpose(1, 0, 2)
    t = TICK * np.arange(STEPS + 1)
    for k in (2, 5, 10, STEPS):
        print(
            f"after {t[k]:.1f} s: beside its way by {np.median(beside[:, k]):.2f} m (median), "
            f"{np.quantile(beside[:, k], 0.99):.2f} m (99 %); "
            f"faster by {np.quantile(faster[:, k], 0.99):.2f} m/s (99 %)"
        )
    within = (beside <= config.track + config.track_rate * t).all(axis=1)
    print(f"within the bound all along: {within.mean():.0%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--brake", type=int, default=0, metavar="N", help="N ways to stop instead")
    options = parser.parse_args()
    if options.brake:
        braking(options.brake, options.seed)
        raise SystemExit
    costs = []
    print(
        json.dumps(fly(options.ticks, options.seed, costs=costs), indent=1, sort_keys=True),
        "certificate, processor time of a tick: p50 {:.2f} ms, p99 {:.2f} ms".format(
            *np.percentile(costs, [50, 99]) * 1e3
        ),
        sep="\n",
    )
