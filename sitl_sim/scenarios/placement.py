"""Where the drones of a scenario start, what they face and fly to, and when: by its seed."""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios.scenario import (
    QUANTUM_MS,
    TICK_MS,
    DronesConfig,
    Scenario,
    drone_names,
    ground_of,
)


def starts(scenario: Scenario) -> Vector:
    """Return the starts (n,3) m on the ground: the formation, moved at random by the seed."""
    ground = ground_of(scenario)
    d = scenario.drones
    flat = _formation(d)
    rng = np.random.default_rng([scenario.seed, 2])
    flat = flat + rng.uniform(-d.jitter, d.jitter, flat.shape)
    if d.shift:
        yaw = 0.0 if d.heading_deg == "target" else np.radians(d.heading_deg)
        flat = flat + rng.uniform(-d.shift, d.shift) * np.array([np.sin(yaw), -np.cos(yaw)])
    return np.column_stack([flat, ground.height(flat[:, 0], flat[:, 1])])


def headings(scenario: Scenario, start: Vector) -> Vector:
    """Return the ENU yaw (n,) rad of each drone at its start."""
    wanted = scenario.drones.heading_deg
    if wanted != "target":
        return np.full(len(start), np.radians(wanted))
    goals = targets(scenario, start)
    if none := [name for name, g in goals.items() if not g]:
        raise SettingsError([f"drones.heading_deg: {none[0]} has no target to face"])
    first = np.array([g[0][:2] for g in goals.values()])
    yaws: Vector = np.arctan2(*(first - start[:, :2]).T[::-1])
    return yaws


def targets(scenario: Scenario, start: Vector) -> dict[str, list[list[float]]]:
    """Return the targets of each drone, world frame, with the place opposite and home.

    Heights of a scenario's targets count from the ground below them.
    """
    m, ground = scenario.mission, ground_of(scenario)
    out = {}
    for name, s in zip(drone_names(scenario), start, strict=True):
        goals = [list(t) for t in m.targets_of.get(name, m.targets)]
        if m.spread and goals:
            place = s[:2] - start[:, :2].mean(axis=0)
            goals[-1] = [*(goals[-1][:2] + place).round(4).tolist(), *goals[-1][2:]]
        if m.exchange:
            opposite = 2 * np.array(scenario.drones.centre) - s[:2]
            goals.append([*opposite.round(4).tolist(), m.altitude])
        if m.home:
            goals.append([round(float(s[0]), 4), round(float(s[1]), 4), m.altitude])
        for g in goals if not ground.flat else ():
            g[2] = round(g[2] + float(ground.height(g[0], g[1])), 4)
        out[name] = goals
    return out


def levels(scenario: Scenario) -> Vector:
    """Return the height (n,) m above its targets at which each drone flies: the levels by lot."""
    n = scenario.drones.count
    rng = np.random.default_rng([scenario.seed, 4])
    return rng.permutation(np.resize(scenario.mission.levels, n))


def frame_yaws(scenario: Scenario) -> Vector:
    """Return the yaw (n,) rad of each vehicle's own frame in the world."""
    d = scenario.drones
    if d.frame_yaw_deg == "random":
        return np.random.default_rng([scenario.seed, 3]).uniform(-np.pi, np.pi, d.count)
    return np.full(d.count, np.radians(float(d.frame_yaw_deg)))


def boot_ms(scenario: Scenario) -> list[int]:
    """Return each vehicle's clock [ms] when the flight begins; companions tick out of phase."""
    n = scenario.drones.count
    return [round(i * TICK_MS / n / QUANTUM_MS) * QUANTUM_MS for i in range(n)]


def _formation(d: DronesConfig) -> Vector:
    """Return the place (n,2) m of each drone in the formation."""
    n, centre = d.count, np.array(d.centre)
    if d.starts:
        if len(d.starts) < n:
            raise SettingsError([f"drones.starts: needs {n} pairs [x, y], got {len(d.starts)}"])
        return np.array(d.starts[:n], float)
    if d.formation == "circle":
        angle = 2 * np.pi * np.arange(n) / n
        ring: Vector = centre + d.ring * np.column_stack([np.cos(angle), np.sin(angle)])
        return ring
    if d.heading_deg == "target":
        raise SettingsError(["drones.heading_deg: a grid needs a number, got 'target'"])
    side = int(np.ceil(np.sqrt(n)))
    grid = np.array([(i % side, i // side) for i in range(n)], float) - (side - 1) / 2
    yaw = np.radians(d.heading_deg)
    forward = np.array([np.cos(yaw), np.sin(yaw)])
    right = np.array([np.sin(yaw), -np.cos(yaw)])
    placed: Vector = centre + d.spacing * (grid[:, :1] * right - grid[:, 1:] * forward)
    return placed
