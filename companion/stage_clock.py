"""How long each stage of a tick takes, by a stop-watch that is passed in."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class StageClock:
    """Runs stages and notes their times [s] in `taken`, by name."""

    def __init__(self, stopwatch: Callable[[], float]) -> None:
        self.taken: dict[str, float] = {}
        self._stopwatch = stopwatch

    def __call__(self, name: str, stage: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run one stage and return its result."""
        start = self._stopwatch()
        result = stage(*args, **kwargs)
        self.taken[name] = self._stopwatch() - start
        return result
