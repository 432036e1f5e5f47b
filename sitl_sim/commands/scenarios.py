"""`sitl-sim scenarios`: what there is to fly, and a plan of each from above."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("--plans", type=Path, metavar="DIR", help="draw NAME.svg of each there")
    command.add_argument("--seed", type=int, default=0, metavar="S", help="of the plans (0)")
    command.add_argument("--missions", metavar="FILE", help="for those whose worlds are in a file")


def show_scenarios(options: argparse.Namespace) -> None:
    """Print a line for each scenario; draw plans where wanted.

    Raises:
        SettingsError: bad input, or matplotlib is not there.
    """
    from sitl_sim.scenarios import scenario as scenarios

    for name in scenarios.names():
        print(f"{name:<14}{scenarios.description(name)}")
        if options.plans is None:
            continue
        wanted = [f"seed={options.seed}"]
        if name == "lsc-forest":
            if options.missions is None:
                continue
            wanted.append(f"world.missions={options.missions}")
        options.plans.mkdir(parents=True, exist_ok=True)
        draw_plan(scenarios.load(name, wanted), options.plans / f"{name}.svg")


def draw_plan(scenario: Any, path: Path) -> None:
    """World, starts and targets of a scenario from above, as SVG.

    Raises:
        SettingsError: matplotlib is not there.
    """
    from sitl_sim.campaigns.study_page import new_figure
    from sitl_sim.scenarios import scenario as scenarios
    from sitl_sim.worlds.generators import build

    figure = new_figure(4.2, 4.2)  # says so where there is no matplotlib
    from matplotlib.patches import Circle, Rectangle

    axes = figure.add_subplot()
    world = build(scenario.world, scenario.seed)
    for c in world["cylinders"]:
        axes.add_patch(Circle((c["x"], c["y"]), c["radius"], color="#8a7558"))
    for b in world["boxes"]:
        (x0, y0, z0), (x1, y1, _) = b["min"], b["max"]
        inside = z0 <= scenario.mission.altitude <= b["max"][2]
        axes.add_patch(
            Rectangle((x0, y0), x1 - x0, y1 - y0, color="#777777", alpha=1 if inside else 0.25)
        )
    start = scenarios.starts(scenario)
    for k, (s, goals) in enumerate(
        zip(start, scenarios.targets(scenario, start).values(), strict=True)
    ):
        way = [s[:2], *(g[:2] for g in goals)]
        colour = f"C{k % 10}"
        axes.plot(*zip(*way, strict=True), "-", color=colour, linewidth=0.7, alpha=0.6)
        axes.plot(*s[:2], "o", color=colour, markersize=4)
        axes.plot(*zip(*way[1:], strict=True), "x", color="k", markersize=5)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(f"{scenario.name}, seed {scenario.seed}")
    figure.savefig(path, metadata={"Date": None})
