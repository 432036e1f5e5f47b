"""The boundary around each stage of a tick: how long it takes, and what stands in where it raises.

An exception in a stage never leaves the tick. The stage's result is replaced by one that claims
nothing, the failure is told, and the guard answers it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
U = TypeVar("U")


class StageClock:
    """Runs stages; notes their times [s] in `taken`, by name, and the first failure in words."""

    def __init__(self, stopwatch: Callable[[], float]) -> None:
        self.taken: dict[str, float] = {}
        self.failure = ""
        self._stopwatch = stopwatch

    def __call__(
        self,
        name: str,
        instead: Callable[[], U],
        stage: Callable[P, T],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> T | U:
        """Run one stage and return its result; what `instead` makes where it raises."""
        start = self._stopwatch()
        result: T | U
        try:
            result = stage(*args, **kwargs)
        except Exception as error:
            result = instead()
            self.failure = self.failure or f"{name}: {described(error)}"
        self.taken[name] = self._stopwatch() - start
        return result


def described(error: BaseException) -> str:
    """Return an exception in one line: its kind, its text, and where it was raised."""
    trace, place = error.__traceback__, ""
    while trace is not None:
        place = f" ({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})"
        trace = trace.tb_next
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{': ' + text if text else ''}{place}"
