"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LINE_EVERY = 10.0  # s of simulated time


@contextmanager
def flight_progress(total: float) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes the simulated time [s] and shows it against `total` [s]."""
    from tqdm import tqdm

    watched = sys.stderr.isatty()
    bar_format = "{l_bar}{bar}| {n:.0f}/{total:.0f} s flown [{elapsed}]"
    printed = 0.0
    with tqdm(
        total=total, unit="s", disable=not watched, leave=False, bar_format=bar_format
    ) as bar:

        def show(t: float) -> None:
            nonlocal printed
            if watched:
                bar.update(t - bar.n)
            elif t - printed >= _LINE_EVERY:
                printed = t
                print(f"{t:.0f} s flown", file=sys.stderr)

        yield show


@contextmanager
def run_progress(total: int, done: int) -> Iterator[Callable[[int, str], None]]:
    """Yield a function that takes a seed and its result; `done` of `total` runs exist already."""
    from tqdm import tqdm

    watched = sys.stderr.isatty()
    with tqdm(total=total, initial=done, unit="run", disable=not watched) as bar:

        def show(seed: int, result: str) -> None:
            line = f"seed {seed}: {result}"
            bar.update()
            if watched:
                bar.write(line, file=sys.stderr)
            else:
                print(line, file=sys.stderr, flush=True)

        yield show
