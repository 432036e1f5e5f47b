"""Render pictures to train on, in shards, beside the training or before it.

    nice python -m training.render --work DIR [--workers W] [--first S] [--shards N]
        [--per-world P]

Shards have the seeds S…S+N−1. Those in the folder are not rendered again. Without --shards it goes
on until it is ended, and waits while the training has yet to take _AHEAD of them.
"""

from __future__ import annotations

import argparse
import time
from multiprocessing import get_context
from pathlib import Path

import cv2

from training.data import complete, rendered, save

_AHEAD = 250  # shards that lie in the folder, of 100 MB each
_FOREVER = 1 << 30  # shards


def main() -> None:
    """Render."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of the shards")
    parser.add_argument("--workers", type=int, default=1, help="processes (1)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first shard (0)")
    parser.add_argument("--per-world", type=int, help="pictures of one world (50)")
    parser.add_argument("--shards", type=int, default=_FOREVER)
    options = parser.parse_args()
    context = get_context("spawn")
    end = options.first + options.shards
    processes = [
        context.Process(
            target=_work, args=(options.work, range(start, end, options.workers), options.per_world)
        )
        for start in range(options.first, options.first + options.workers)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()


def _work(folder: Path, seeds: range, per_world: int | None) -> None:
    """Render the shards of the seeds that are missing."""
    cv2.setNumThreads(1)
    endless = len(seeds) * seeds.step > _FOREVER // 2
    for seed in seeds:
        while endless and len(complete(folder)) >= _AHEAD:
            time.sleep(1.0)
        name = f"looks-{seed:06d}"
        if name not in complete(folder):
            save(folder, name, rendered(seed, per_world))
            print(name, flush=True)


if __name__ == "__main__":
    main()
