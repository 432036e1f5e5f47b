"""Draws time.svg, the picture of where the time of a flight goes, from a profile of one.

py-spy record --subprocesses --format raw -o stacks.txt -- sitl-sim run forest --in-process --seed 1
python docs/time_figure.py stacks.txt

Fly once before, so that nothing is compiled meanwhile. Compiling, importing, waiting and
the page of the flight are left out.
"""

import argparse
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

OUT = Path(__file__).with_name("time.svg")
SIMULATOR, COMPANION = "#b8c4cf", "#1f6fb4"
# Of one file each: a sample is of the first group with a file that is on its stack.
GROUPS = {
    "not counted": ("numba/core/", "importlib", "sitl_sim/figures/", "threading.py"),
    "pictures: painted, developed": ("sitl_sim/sensors/looks/", "sitl_sim/sensors/"),
    "eyes: closer look": ("companion/perception/closer_look.py",),
    "eyes: search": ("companion/perception/network_search.py", "companion/perception/heat_map.py"),
    "eyes: the rest": ("companion/perception/",),
    "log": ("companion/flightlog/",),
    "own state, delays": (
        "companion/estimation/vehicle",
        "companion/estimation/own_",
        "companion/estimation/motion.py",
        "companion/estimation/velocity_",
    ),
    "map of obstacles": (
        "companion/estimation/known_obstacles.py",
        "companion/estimation/obstacle_map.py",
    ),
    "tracks of neighbours": ("companion/estimation/neighbours.py",),
    "guidance": ("companion/guidance/",),
    "plan: the NMPC": ("companion/control/",),
    "guard, monitors, certificate": ("companion/supervision/",),
    "MAVLink, both ends": ("mavlink_bridge/",),
    "vehicles and their state": ("sitl_sim/vehicles/",),
    "companion: the rest": ("companion/",),
    "simulator: between processes": ("multiprocessing/connection.py",),
    "simulator: the rest": ("sitl_sim/",),
}


def group_of(stack: str) -> str:
    """Return the group of a stack, frames by `;`: each a function and (file:line)."""
    files = re.findall(r"\(([^()]*?)(?::\d+)?\)(?:;|$)", stack)
    for name, parts in GROUPS.items():
        if any(part in file for file in files for part in parts):
            return name
    return "simulator: the rest"


def shares(lines: Iterable[str]) -> dict[str, float]:
    """Return the share of each group, the largest first, of the samples of lines `stack count`."""
    counts: Counter[str] = Counter()
    for line in lines:
        stack, _, count = line.rpartition(" ")
        counts[group_of(stack)] += int(count)
    counts.pop("not counted", None)
    total = sum(counts.values())
    return {name: count / total for name, count in counts.most_common()}


def draw(found: dict[str, float], title: str) -> Figure:
    """Return a bar for each group; what the drone's own companion takes has its own colour."""
    figure = Figure(figsize=(7.2, 0.3 * len(found) + 0.9), layout="constrained")
    ax = figure.subplots()
    names, values = list(found)[::-1], [100.0 * v for v in found.values()][::-1]
    world = ("pictures", "vehicles", "simulator")
    ax.barh(names, values, color=[SIMULATOR if n.startswith(world) else COMPANION for n in names])
    for y, value in enumerate(values):
        ax.annotate(f"{value:.0f} %", (value, y), (4, 0), textcoords="offset points", va="center")
    ax.set_xlabel("% of the samples; blue: the companion, grey: the simulator")
    ax.set_title(title, loc="left", fontsize="medium")
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stacks", type=Path, help="raw stacks of py-spy")
    parser.add_argument("--title", default="forest, nine drones, as packaged")
    args = parser.parse_args()
    mpl.rcParams["svg.hashsalt"] = "swarm-companion"
    with args.stacks.open() as lines:
        found = shares(lines)
    for name, share in found.items():
        print(f"{share:6.1%}  {name}")
    draw(found, args.title).savefig(OUT, metadata={"Date": None})


if __name__ == "__main__":
    main()
