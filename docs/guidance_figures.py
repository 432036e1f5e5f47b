"""Draws guidance.svg, the pictures of guidance.md, with the code that flies.

python docs/guidance_figures.py
"""

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch

from companion.estimation.delay import Delay
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.guidance.detour import Detour
from companion.guidance.gaze import Gaze, GazeConfig
from companion.guidance.right_of_way import RightOfWayConfig, pass_on_right
from companion.guidance.speed_limits import (
    SpeedLimitConfig,
    headway_speed,
    relative_speed_limit,
    visibility_speed,
)
from companion.guidance.threat import ThreatConfig, threat
from companion.supervision.certificate import Scene, check
from companion.supervision.certify import CertificateConfig, bounds_of, braking_law
from companion.supervision.evasion import STRAIGHT, aside, simulate
from companion.supervision.guard_config import GuardConfig
from companion.types import Detection, Track
from mavlink_bridge.wire.messages import VehicleState

OUT = Path(__file__).with_name("guidance.svg")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
OWN, OTHER, TRUNK, WARN = "#1f6fb4", "#c0392b", "#7a5c3e", "#e67e22"
CRUISE = 1.65
Place = tuple[float, float, float]


def flying(
    p: Place = (0.0, 0.0, 2.0), v: Place = (0.0, 0.0, 0.0), time: float = 0.0
) -> VehicleState:
    """Return a drone's own state, level."""
    return VehicleState(time, np.array(p, float), np.array(v, float), LEVEL, np.zeros(3))


def neighbour(p: Place, v: Place = (0.0, 0.0, 0.0)) -> Track:
    """Return a neighbour that is in sight."""
    return Track(1, np.array(p, float), np.array(v, float), np.eye(6) * 1e-3, 5.0, 0.0)


def line_of_sight(ax: Axes) -> None:
    """The sweep of eq. (7), and a swing towards a neighbour out of view from 9 to 11 s."""
    gaze, times = Gaze(GazeConfig(seed=3)), np.arange(0.0, 18.0, 0.1)
    at = math.radians(125.0)
    psi = np.degrees(
        [
            gaze.update(
                t, np.array([1.5, 0.0, 0.0]), np.array([20.0, 0, 0]), 0.0, [at] * int(9 <= t < 11)
            )
            for t in times
        ]
    )
    psi = np.degrees(np.unwrap(np.radians(psi)))
    psi -= 360.0 * np.round(psi[-1] / 360.0)
    ax.fill_between(times, psi - 80.0, psi + 80.0, color=OWN, alpha=0.15, lw=0)
    ax.plot(times, psi, color=OWN)
    ax.plot([9, 11], [125, 125], color=OTHER, lw=3)
    ax.text(9.1, 138, "a neighbour out of view", color=OTHER)
    ax.text(0.0, 120, "look\nround", color=OWN)
    ax.text(3.4, -130, "sweep", color=OWN)
    ax.set(xlabel="time [s]", ylabel="off the way [°]", ylim=(-160, 170))
    ax.set_title("1  Line of sight, and what it sees")


def memory(ax: Axes) -> None:
    """Where two neighbours are believed to be 0 to 3 s after they left the view."""
    rng = np.random.default_rng(2)
    for y, steady in ((1.4, True), (-1.4, False)):
        tracker, x, speed = Tracker(TrackerConfig()), 3.0, 1.0
        for k in range(30):
            if not steady:
                speed = min(speed + 0.3, 1.8) if k % 12 < 6 else max(speed - 0.3, 0.2)
            x += 0.1 * speed
            ray = np.array([x, y, 0.0]) + rng.normal(0.0, 0.02, 3)
            size = float(np.linalg.norm(ray))
            look = Detection(ray / size, size, 0.005, 0.03)
            tracker.update(k / 10, [look], flying((0, 0, 0), time=k / 10), LEVEL, None)
        ax.plot([x - 1.5, x], [y, y], color=OTHER, lw=3)
        for k in range(30, 61):
            if k % 10 == 0:
                (track,) = tracker.tracks()
                sigma = np.sqrt(np.diag(track.P))
                ax.add_patch(
                    Ellipse(track.p[:2], 2 * sigma[0], 2 * sigma[1], fill=False, color=OTHER)
                )
                ax.plot(*track.p[:2], ".", color=OTHER)
                ax.text(track.p[0], y + sigma[1] + 0.12, f"{(k - 30) // 10} s", ha="center")
            tracker.update(k / 10, [], flying((0, 0, 0), time=k / 10), LEVEL, None)
        words = "kept its velocity" if steady else "went on and off"
        ax.text(3.2, y + (0.45 if steady else -0.55), words, color=OTHER, va="center")
    ax.set(xlim=(3, 10.5), ylim=(-3.4, 3.4), aspect="equal", xlabel="[m]")
    ax.set_title("2  Memory of neighbours, 1 σ")


def threats(ax: Axes) -> None:
    """Eq. (8) to (10), over distance and closing speed."""
    config, own = ThreatConfig(), flying()
    away, closing = np.meshgrid(np.linspace(0.8, 6.0, 80), np.linspace(-1.0, 3.0, 80))
    values = np.vectorize(
        lambda r, c: threat(own, np.array([r, 0.0, 2.0]), np.array([-c, 0.0, 0.0]), 2.0, config)
    )(away, closing)
    drawn = ax.contour(away, closing, values, levels=[0.05, 0.1, 0.2, 0.5, 1, 2, 4], colors=OTHER)
    ax.clabel(drawn, fmt="%g")
    ax.set(xlabel="distance [m]", ylabel="closing speed [m/s]", title="3  Threat [m/s]")


def speeds(ax: Axes) -> None:
    """How fast the drone may fly: by where it looks, by who is ahead, by who is near."""
    config, own = SpeedLimitConfig(), flying(v=(1.0, 0, 0))
    way, away = np.array([10.0, 0.0, 0.0]), np.linspace(0.8, 5.0, 200)
    off = np.linspace(0.0, 150.0, 200)
    view = [CRUISE * visibility_speed(config, math.radians(x), way) for x in off]
    ahead = [
        headway_speed(own, [neighbour((x, 0, 2))], way, CRUISE, config, RightOfWayConfig(), 10.0)
        for x in away
    ]
    near = [
        relative_speed_limit(own, [neighbour((x, 0, 2), (0.4, 0, 0))], CRUISE, 1.85, config)
        for x in away
    ]
    above = ax.twiny()
    above.plot(off, view, color=OWN)
    above.set_xlabel("its way is off its line of sight [°]", color=OWN)
    above.text(35, 1.69, "visibility", color=OWN)
    ax.plot(away, ahead, color=OTHER)
    ax.text(2.55, 0.8, "headway:\nstands ahead", color=OTHER)
    ax.plot(away, near, color=WARN)
    ax.text(2.0, 1.89, "relative speed: flies at 0.4 m/s", color=WARN)
    ax.set(xlabel="distance of a neighbour [m]", ylabel="[m/s]", xlim=(0, 5), ylim=(0, 2.05))
    ax.set_title("4  Speed limits")


def ways(ax: Axes) -> None:
    """Round a hedge, and to the right of a neighbour that comes."""
    hedge = np.array([[4.0, y, 0.3] for y in (-1.2, -0.1, 1.0)])
    detour, p, goal = Detour(np.zeros((0, 4))), np.array([0.0, 0.0, 2.0]), np.array([9.0, 0, 2.0])
    path = [p]
    for _ in range(200):
        aim = detour.aim(p, goal, hedge, 0.6)
        step = aim - p
        p = p + 0.06 * step / max(np.linalg.norm(step), 0.06)
        path.append(p)
    path = np.array(path)
    for x, y, radius in hedge:
        ax.add_patch(Circle((x, y), radius, color=TRUNK))
    ax.plot(path[:, 0], path[:, 1], color=OWN)
    ax.plot(9, 0, "x", color=OWN)
    ax.text(0.0, 2.4, "a hedge: the shortest way round")
    own, comes = flying((0, -4.5, 2), (1.5, 0, 0)), neighbour((4.0, -4.4, 2), (-1.0, 0, 0))
    aim = np.array([9.0, -4.5, 2.0])
    turned = pass_on_right(own, [comes], np.zeros((0, 3)), aim, RightOfWayConfig())
    ax.add_patch(
        FancyArrowPatch((0, -4.5), turned[:2], arrowstyle="->", color=OWN, mutation_scale=12)
    )
    ax.plot([0, 9], [-4.5, -4.5], ":", color=OWN, lw=1)
    ax.add_patch(
        FancyArrowPatch((4.0, -4.4), (2.6, -4.4), arrowstyle="->", color=OTHER, mutation_scale=12)
    )
    ax.plot(4.0, -4.4, "o", color=OTHER)
    ax.text(0.0, -3.4, "a neighbour comes: 1 m to the right")
    ax.set(xlim=(-0.5, 9.8), ylim=(-7.6, 3.2), aspect="equal", xlabel="[m]", title="5  Ways")


def stops(ax: Axes) -> None:
    """Ways to stop from 1.5 m/s; a neighbour that flies across, and what it can reach."""
    guard = GuardConfig()
    law = braking_law(guard, Delay(0.05, 0.004))
    x0 = np.array([0.0, 0.0, 2.0, 1.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    bounds = bounds_of(CertificateConfig(), guard, 0.2)
    row = [2.1, 1.5, 2.0, 0.0, -0.8, 0.0, 0.002, 0.0, 0.01, 0.0, 0.0]
    none = np.zeros((0, 3))
    scene = Scene(np.array([row]), np.zeros((0, 6)), none, np.zeros((0, 4)), np.full(36, 5.0))
    for family in (STRAIGHT, aside(x0[3:6], 1.2, 0.5)):
        flown = simulate(x0, family, np.zeros(3), law, None)
        found = check(flown, x0, np.zeros(3), scene, bounds)
        for places, margin in zip(flown.p, found.margin, strict=True):
            color = "#2e8b57" if margin >= 0.0 else OTHER
            ax.plot(places[:, 0], places[:, 1], color=color, lw=1.5)
            ax.plot(*places[-1, :2], "o", color=color, ms=4)
    for t in (0.0, 0.4, 0.8):
        at = (2.1, 1.5 - 0.8 * t)
        ax.add_patch(Circle(at, 0.4 + t * t, fill=False, color=WARN, lw=1))
        ax.text(at[0] + 0.4 + t * t, at[1], f" {t:g} s", color=WARN, va="center")
    ax.set(xlim=(-0.6, 3.6), ylim=(-1.4, 2.1), aspect="equal", xlabel="[m]")
    ax.set_title("6  Ways to stop: accepted, refused")


def main() -> None:
    """Draw all six."""
    mpl.rcParams["svg.fonttype"] = "none"
    mpl.rcParams["svg.hashsalt"] = "swarm-companion"
    figure = Figure(figsize=(13, 8.5), layout="constrained")
    panels = (line_of_sight, memory, threats, speeds, ways, stops)
    for ax, draw in zip(figure.subplots(2, 3).flat, panels, strict=True):
        draw(ax)
    figure.savefig(OUT, metadata={"Date": None})


if __name__ == "__main__":
    main()
