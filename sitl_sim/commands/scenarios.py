"""`sitl-sim scenarios`: the packaged scenarios, a plan of each from above, and how hard it is."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

if TYPE_CHECKING:
    from sitl_sim.scenarios.scenario import Scenario

HELP = "list them; draw their plans; how hard their worlds are"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is drawn and where."""
    parser.add_argument(
        "files", nargs="*", metavar="FILE", help="scenarios of your own (the packaged ones)"
    )
    parser.add_argument("--plans", type=Path, metavar="DIR", help="draw NAME.svg of each there")
    parser.add_argument(
        "--difficulty",
        action="store_true",
        help="how narrow the ways are, how they turn, and how many trunks stand there",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the worlds (0)")
    parser.add_argument("--missions", metavar="FILE", help="for those whose worlds are in a file")


def run(options: argparse.Namespace) -> int:
    """Print a line for each scenario; draw plans and tell difficulties where that is asked.

    Raises:
        SettingsError: bad input.
    """
    if options.plans is not None:
        require("matplotlib")
    from sitl_sim.scenarios import scenario as scenarios

    for name in options.files or scenarios.names():
        if options.files:
            world = scenarios.load(name, []).world
            shapes = f"{len(world.cylinders)} trunks, {len(world.boxes)} boxes listed or from files"
            print(f"{name}: {shapes}; generator {world.generator}")
        else:
            print(f"{name:<14}{scenarios.description(name)}")
        if options.plans is None and not options.difficulty:
            continue
        changes = [f"seed={options.seed}"]
        if name == "lsc-forest":
            if options.missions is None:
                continue
            changes.append(f"world.missions={options.missions}")
        scenario = scenarios.load(name, changes)
        if options.difficulty:
            print(f"    {difficulty_of(scenario)}")
        if options.plans is not None:
            options.plans.mkdir(parents=True, exist_ok=True)
            draw_plan(scenario, options.plans / f"{Path(name).stem}.svg")
    return EXIT_OK


def difficulty_of(scenario: Scenario) -> str:
    """Return in words how hard a scenario's world is, for the seed that it has."""
    from sitl_sim.scenarios import placement
    from sitl_sim.worlds.difficulty import NoWay, difficulty
    from sitl_sim.worlds.generators import build

    world, starts = build(scenario.world, scenario.seed), placement.starts(scenario)
    goals = [np.array(way) for way in placement.targets(scenario, starts).values()]
    try:
        found = difficulty(world, starts, goals, scenario.drones.radius)
    except NoWay as error:
        return str(error)
    return (
        f"obstruction {found.obstruction:.2f}, angle over length {found.angle_over_length:.3f}, "
        f"way {found.length:.0f} m, {found.trunks_per_hectare:.0f} trunks a hectare"
    )


def draw_plan(scenario: Scenario, path: Path) -> None:
    """Draw world, starts and targets of a scenario from above, as SVG."""
    from matplotlib.patches import Circle, Rectangle

    from sitl_sim.campaigns.study_page import new_figure
    from sitl_sim.scenarios import placement
    from sitl_sim.worlds.generators import build

    figure = new_figure(4.2, 4.2)
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
    start = placement.starts(scenario)
    for k, (s, goals) in enumerate(
        zip(start, placement.targets(scenario, start).values(), strict=True)
    ):
        path_xy = [s[:2], *(g[:2] for g in goals)]
        colour = f"C{k % 10}"
        axes.plot(*zip(*path_xy, strict=True), "-", color=colour, linewidth=0.7, alpha=0.6)
        axes.plot(*s[:2], "o", color=colour, markersize=4)
        axes.plot(*zip(*path_xy[1:], strict=True), "x", color="k", markersize=5)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(f"{scenario.name}, seed {scenario.seed}")
    figure.savefig(path, metadata={"Date": None})
