"""`sitl-sim faults` and `sitl-sim soak`."""

from __future__ import annotations

import argparse
from typing import Any


def add_arguments(commands: Any) -> None:
    """Their command lines, below the parser's `commands`."""
    commands.add_parser("faults", help="kinds of faults that a scenario can have")
    soak = commands.add_parser("soak", help="fly for hours with random faults; does memory grow?")
    soak.add_argument("--hours", type=float, default=2.0, help="simulated (2)")
    soak.add_argument("--drones", type=int, default=3, metavar="N")
    soak.add_argument("--minutes", type=float, default=5.0, help="of one flight (5)")
    soak.add_argument("--seed", type=int, default=0, metavar="S")


def list_faults() -> str:
    """A line for each kind: its name, its amount where not given, what that means."""
    from sitl_sim.faults.catalogue import KINDS

    width = max(map(len, KINDS))
    lines = [
        f"{kind:<{width}}  {'' if m.default is None else f'{m.default:g}':>7}  {m.text}"
        for kind, m in KINDS.items()
    ]
    return "\n".join([f"{'kind':<{width}}  {'amount':>7}  means", *lines])


def run_soak(options: argparse.Namespace) -> bool:
    """Fly, a line after each flight; whether nothing collided and nothing grew.

    Raises:
        SettingsError: nothing can be flown for so long, by so many.
    """
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.campaigns.soak import growth, soak

    least = {"hours": 0.001, "minutes": 0.01, "drones": 1, "seed": 0}
    wrong = [f"--{k}: must be at least {low:g}" for k, low in least.items()
             if not getattr(options, k) >= low]  # fmt: skip
    if wrong:
        raise SettingsError(wrong)
    passed = []
    for p in soak(options.hours, options.drones, options.minutes, options.seed):
        passed.append(p)
        print(
            f"{p.hours:6.3f} h  {p.faults:3d} faults  {p.grounded} grounded  "
            f"{p.collisions} collisions  {p.rss_mb:7.1f} MB  {p.files} files",
            flush=True,
        )
    memory, files = growth(passed)
    collisions = sum(p.collisions for p in passed)
    print(f"{passed[-1].hours:.2f} h: {collisions} collisions of healthy drones, "
          f"memory {memory:+.1f} MB, files {files:+d} since the second flight")  # fmt: skip
    return collisions == 0 and memory <= 5.0 and files <= 0
