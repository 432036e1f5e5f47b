"""Records the instances that `companion bench nmpc` measures: python -m nmpc.record FILE.

Run from tests/companion. Flights of `plant.py`: nine drones through a forest, ten that cross
in one, head-on pairs, starts inside a safety radius; windows of six ticks at seeded times.
"""

import sys
from pathlib import Path

import numpy as np

from companion.nmpc import Instance, NmpcConfig
from companion.nmpc.bench import Run, save

from .plant import drone, fly, forest

LENGTH = 6


def windows(kind: str, count: int, seed: int, *arguments: object, **options: object) -> list[Run]:
    """Fly, and take `count` windows of LENGTH ticks, each of some drone at some time."""
    seen: dict[tuple[int, int], Instance] = {}

    def note(tick: int, number: int, instance: Instance) -> None:
        seen[tick, number] = instance

    fly(*arguments, seen=note, **options)  # type: ignore[arg-type]
    ticks, drones = max(t for t, _ in seen), 1 + max(n for _, n in seen)
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        start, number = int(rng.integers(0, ticks - LENGTH)), int(rng.integers(drones))
        found.append(Run(kind, tuple(seen[start + i, number] for i in range(LENGTH))))
    return found


def main(path: Path) -> None:
    config = NmpcConfig()
    starts = [[-27 + 1.5 * (i // 3), 1.5 * (i % 3), 2] for i in range(9)]
    runs = windows(
        "forest",
        16,
        1,
        [drone(config, s) for s in starts],
        [[27, 1, 2]] * 9,
        40,
        cylinders=forest(1),
        stop=3.0,
    )
    angles = np.arange(10) * 2 * np.pi / 10 + 0.05
    ring = [[34 * np.cos(a), 34 * np.sin(a), 2] for a in angles]
    runs += windows(
        "crossing",
        18,
        2,
        [drone(config, s, float(np.arctan2(-s[1], -s[0]))) for s in ring],
        [[-s[0], -s[1], 2] for s in ring],
        60,
        cylinders=forest(2),
        stop=1.0,
    )
    pair = [drone(config, [0, 0, 2]), drone(config, [10, 0.1, 2], np.pi)]
    runs += windows("head-on", 4, 3, pair, [[12, 0, 2], [0, 0, 2]], 7)
    near = [drone(config, [0, 0, 2]), drone(config, [0.5, 0.1, 2])]
    runs += windows("inside", 4, 4, near, [[12, 0, 2], [12, 2, 2]], 1.4)
    save(path, runs)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
