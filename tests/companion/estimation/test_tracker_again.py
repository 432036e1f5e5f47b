"""The tracker against a second one, of one track at a time, as textbooks write it.

IMM after Blom and Bar-Shalom; assignment by SciPy. Neighbours move, are missed, go out of view and
come back; ghosts appear; frames are older than ticks.
"""

import copy
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from companion.estimation.existence import CONFIRMED, SUREST
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState

CONFIG = TrackerConfig(
    acceleration=2.2, drift=0.5, keeps_on=2.5, manoeuvres=1.2, velocity_birth=1.1,
    attitude_sigma=0.01, detected=0.8, ghosts=0.06, unseen_max=2.0, sigma_max=2.0, damping=0.8,
    along=1.3, speed_max=3.0, clear=0.25,
)  # fmt: skip
MOUNT = np.array([0.5, -0.5, 0.5, -0.5])
H = np.hstack([np.eye(3), np.zeros((3, 3))])


@dataclass
class One:
    """A neighbour: mean, covariance and probability of each mode."""

    name: int
    born: float
    seen: float
    x: list
    P: list
    mu: list = field(default_factory=lambda: [0.5, 0.5])
    odds: float = 0.0
    confirmed: bool = False
    along: float = 0.0

    def mix(self, dt):
        c = CONFIG
        leave = [1.0 - math.exp(-dt / c.keeps_on), 1.0 - math.exp(-dt / c.manoeuvres)]
        move = [[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]]
        mu = [sum(move[i][j] * self.mu[i] for i in (0, 1)) for j in (0, 1)]
        x, P = [], []
        for j in (0, 1):
            w = [move[i][j] * self.mu[i] / mu[j] for i in (0, 1)]
            mean = w[0] * self.x[0] + w[1] * self.x[1]
            x.append(mean)
            P.append(sum(
                w[i] * (self.P[i] + np.outer(self.x[i] - mean, self.x[i] - mean)) for i in (0, 1)
            ))  # fmt: skip
        self.x, self.P, self.mu = x, P, mu

    def carry(self, dt, fades, own_velocity):
        for j, sigma in enumerate((CONFIG.drift, CONFIG.acceleration)):
            keep = math.exp(-CONFIG.damping * dt) if fades and j == 1 else 1.0
            F = np.eye(6)
            F[:3, 3:] = dt * np.eye(3)
            F[3:, 3:] = keep * np.eye(3)
            u = np.concatenate([np.zeros(3), (1.0 - keep) * self.along * own_velocity])
            G = np.vstack([0.5 * dt**2 * np.eye(3), dt * np.eye(3)])
            self.x[j] = F @ self.x[j] + u
            self.P[j] = F @ self.P[j] @ F.T + sigma**2 * G @ G.T

    def mixture(self):
        mean = self.mu[0] * self.x[0] + self.mu[1] * self.x[1]
        P = sum(
            self.mu[j] * (self.P[j] + np.outer(self.x[j] - mean, self.x[j] - mean)) for j in (0, 1)
        )
        return mean, P

    def correct(self, z, r, lasting, here, stale):
        """Correct both modes: by Joseph's form, as the velocity's gain is not the optimal one."""
        ray = (z - here) / np.linalg.norm(z - here)
        known = np.eye(3) - lasting * np.outer(ray, ray)
        fit = []
        for j in (0, 1):
            S = H @ self.P[j] @ H.T + r
            K = self.P[j] @ H.T @ np.linalg.inv(S)
            off = z - H @ self.x[j]
            elsewhere = stale and off @ np.linalg.inv(S) @ off > 3.0
            K[3:] = K[3:] @ (np.zeros((3, 3)) if elsewhere else known)
            self.x[j] = self.x[j] + K @ off
            speed = np.linalg.norm(self.x[j][3:])
            self.x[j][3:] *= min(1.0, CONFIG.speed_max / speed)
            A = np.eye(6) - K @ H
            self.P[j] = A @ self.P[j] @ A.T + K @ r @ K.T
            fit.append(-0.5 * (off @ np.linalg.inv(S) @ off + np.log(np.linalg.det(S))))
        self.weigh(np.exp(np.array(fit) - max(fit)))

    def weigh(self, likelihood):
        mu = np.array(self.mu) * likelihood
        mu = np.maximum(mu / mu.sum(), 1e-3)
        self.mu = list(mu / mu.sum())


class Reference:
    """Many of them."""

    def __init__(self):
        self.all, self.time, self.looked, self.count = [], None, -math.inf, 0
        self.own_velocity, self.kept = np.zeros(3), (-math.inf, [])

    def predict(self, time):
        if self.time is not None and self.kept[0] <= time < self.time:
            self.time = self.kept[0]
            for one, was in zip(self.all, self.kept[1], strict=True):
                one.x, one.P, one.mu = copy.deepcopy((was.x, was.P, was.mu))
        dt = 0.0 if self.time is None else time - self.time
        self.time = time
        for one in self.all:
            if dt < 0.0:
                for x in one.x:
                    x[:3] += dt * x[3:]
            elif dt > 0.0:
                one.mix(dt)
                fades = time - min(time - self.looked, 0.25) - one.seen > 0.15
                one.carry(dt, fades, self.own_velocity)

    def looks(self, detections, own):
        turn = Rotation.from_quat(np.roll(own.q_wb, -1)) * Rotation.from_quat(np.roll(MOUNT, -1))
        for d in detections:
            ray = turn.apply(d.direction)
            across = d.range * math.hypot(d.sigma_bearing, CONFIG.attitude_sigma)
            r = across**2 * (np.eye(3) - np.outer(ray, ray))
            r += d.sigma_range**2 * np.outer(ray, ray)
            lasting = (d.sigma_lasting / d.sigma_range) ** 2
            yield own.p + d.range * ray, r, d.sigma_range <= CONFIG.clear * d.range, lasting

    @staticmethod
    def in_line(p, P, z, r, here):
        """Return whether place p and look z may be in one direction, by doubts P and r."""
        doubt = 0.0
        for place, covariance in ((p - here, P), (z - here, r)):
            along = place / np.linalg.norm(place)
            across = np.linalg.svd(along[None])[2][1:]  # two unit vectors
            doubt += np.trace(across @ covariance @ across.T) / 2 / (place @ place)
        cosine = (p - here) @ (z - here) / np.linalg.norm(p - here) / np.linalg.norm(z - here)
        return math.acos(min(cosine, 1.0)) ** 2 < CONFIG.gate * doubt

    def pairs(self, looks, time, here):
        score = np.full((len(self.all), len(looks)), 1e3)
        for n, one in enumerate(self.all):
            mean, P = one.mixture()
            for k, (z, r, clear, _) in enumerate(looks):
                S = P[:3, :3] + r
                distance = (z - mean[:3]) @ np.linalg.inv(S) @ (z - mean[:3])
                near = distance < CONFIG.gate and self.in_line(mean[:3], P[:3, :3], z, r, here)
                if near and (clear or time - one.seen <= 0.5):
                    score[n, k] = distance + np.log(np.linalg.det(S))
        rows, columns = linear_sum_assignment(score)
        return [(n, k) for n, k in zip(rows, columns, strict=True) if score[n, k] < 1e3]

    def update(self, time, detections, own, in_view):
        self.predict(time)
        self.looked = time
        looks = list(self.looks(detections, own))
        pairs = self.pairs(looks, time, own.p)
        found = {n for n, _ in pairs}
        if in_view is not None:
            for n, one in enumerate(self.all):
                shows = np.array([in_view[n], in_view[n + len(self.all)]], float)
                if n not in found and shows.any():
                    one.odds += math.log(1.0 - CONFIG.detected * float(np.dot(one.mu, shows)))
                    one.weigh(1.0 - CONFIG.detected * shows)
        for n, k in pairs:
            one, (z, r, clear, lasting) = self.all[n], looks[k]
            one.correct(z, r, lasting, own.p, time - one.seen > 0.5)
            one.seen = time
            one.odds += (1.0 if clear else 0.3) * math.log(CONFIG.detected / CONFIG.ghosts)
            off = np.linalg.norm(one.mixture()[0][3:] - own.v)
            one.along = math.exp(-((off / CONFIG.along) ** 2))
        if pairs:
            for one in self.all:
                one.odds = min(one.odds, SUREST)
                one.confirmed |= one.odds >= CONFIRMED
        self.own_velocity = own.v
        least = SUREST / CONFIG.unseen_max
        self.all = [
            one
            for one in self.all
            if one.odds >= least * (time - one.seen)
            and math.sqrt(np.trace(one.mixture()[1][:3, :3])) < CONFIG.sigma_max
        ]
        for k in sorted(set(range(len(looks))) - {k for _, k in pairs}):
            z, r, *_ = looks[k]
            x, P = np.concatenate([z, np.zeros(3)]), np.zeros((6, 6))
            P[:3, :3], P[3:, 3:] = r, CONFIG.velocity_birth**2 * np.eye(3)
            self.count += 1
            two = [x.copy(), x.copy()], [P.copy(), P.copy()]
            self.all.append(One(self.count, time, time, *two))
        self.kept = (time, copy.deepcopy(self.all))


class World:
    """Four neighbours about a drone that flies and turns; what its camera shows."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.p = [2.5, 0.0, 2.0] + self.rng.normal(size=(4, 3)) * [1.5, 1.5, 0.5]
        self.v = self.rng.normal(size=(4, 3)) * [1.0, 1.0, 0.2]
        self.a = np.zeros((4, 3))

    def step(self, dt, time):
        """Fly on, and not far from the drone."""
        if self.rng.random() < 0.2:
            self.a = self.rng.normal(size=(4, 3)) * [2.0, 2.0, 0.3]
        back = 0.5 * (self.own(time).p - self.p)
        self.p = self.p + dt * self.v
        self.v = np.clip(self.v + dt * (self.a + back), -2.0, 2.0)

    def own(self, time):
        yaw = 1.5 * math.sin(0.7 * time)
        turn = Rotation.from_euler("zyx", [yaw, 0.1 * math.sin(time), 0.1])
        v = np.array([1.2 * math.cos(0.3 * time), 0.4, 0.0])
        q = np.roll(turn.as_quat(), 1)
        return VehicleState(time, np.array([0.5 * time, 0.0, 2.0]), v, q, np.zeros(3))

    def seen(self, time):
        """Detections, noisy, some missed, with ghosts; some have a range that says little."""
        own, rng, out = self.own(time), self.rng, []
        turn = Rotation.from_quat(np.roll(own.q_wb, -1)) * Rotation.from_quat(np.roll(MOUNT, -1))
        places = [*self.p, rng.normal(size=3) * [4.0, 4.0, 1.0]]  # the last is a ghost
        for n, p in enumerate(places):
            ray = turn.inv().apply(p - own.p)
            away = float(np.linalg.norm(ray))
            if ray[2] < 0.2 * away or rng.random() < (0.15 if n < len(self.p) else 0.7):
                continue
            spread = float(rng.choice([0.02, 0.05, 0.4])) * away
            ray = ray / away + 0.01 * rng.normal(size=3)
            seen = max(away + 0.5 * spread * rng.normal(), 0.2)
            lasting = float(rng.choice([0.0, 0.9])) * spread
            ray /= np.linalg.norm(ray)
            out.append(Detection(ray, seen, 0.015, spread, sigma_lasting=lasting))
        return out

    def shows(self, places, time):
        own = self.own(time)
        turn = Rotation.from_quat(np.roll(own.q_wb, -1)) * Rotation.from_quat(np.roll(MOUNT, -1))
        rays = turn.inv().apply(places - own.p)
        return (rays[:, 2] > 0.2 * np.linalg.norm(rays, axis=1)).tolist()


def compare(tracker, reference):
    found = tracker.tracks()
    wanted = [one for one in reference.all if one.confirmed]
    assert [t.id for t in found] == [one.name for one in wanted]
    for t, one in zip(found, wanted, strict=True):
        mean, P = one.mixture()
        assert t.p == pytest.approx(mean[:3], abs=1e-6)
        assert t.v == pytest.approx(mean[3:], abs=1e-6)
        assert pytest.approx(P, abs=1e-6) == t.P
        assert t.age == pytest.approx(reference.time - one.born)
        assert t.unseen == pytest.approx(reference.time - one.seen)
    return len(found)


@pytest.mark.parametrize("seed", range(12))
def test_tracks_are_those_of_a_second_tracker(seed):
    world, tracker, reference = World(seed), Tracker(CONFIG), Reference()
    most, longest = 0, 0.0
    for k in range(70):
        time = 10.0 + 0.1 * k
        world.step(0.1, time)
        if world.rng.random() > 0.1:  # a frame, taken a moment before the tick
            taken = time - world.rng.uniform(0.01, 0.09)
            seen, own = world.seen(taken), world.own(taken)
            tracker.predict(taken)
            reference.predict(taken)
            in_view = world.shows(tracker.positions(), taken) if reference.all else None
            tracker.update(taken, seen, own, MOUNT, in_view)
            reference.update(taken, seen, own, in_view)
        tracker.predict(time)
        reference.predict(time)
        most = max(most, compare(tracker, reference))
        longest = max([longest, *(t.unseen for t in tracker.tracks())])
    assert most >= 2
    assert longest > 0.5


def test_places_of_both_modes_are_told_one_after_the_other():
    world, tracker, reference = World(3), Tracker(CONFIG), Reference()
    for k in range(8):
        world.step(0.1, 10.0 + 0.1 * k)
        seen, own = world.seen(10.0 + 0.1 * k), world.own(10.0 + 0.1 * k)
        tracker.update(10.0 + 0.1 * k, seen, own, MOUNT)
        reference.update(10.0 + 0.1 * k, seen, own, None)
    tracker.predict(12.0)
    reference.predict(12.0)
    wanted = [one.x[j][:3] for j in (0, 1) for one in reference.all]
    assert tracker.positions() == pytest.approx(np.array(wanted), abs=1e-6)
    tracker.predict(11.9)  # older than the tick, newer than the frame
    reference.predict(11.9)
    compare(tracker, reference)
    tracker.predict(9.0)  # older than all
    reference.predict(9.0)
    compare(tracker, reference)
