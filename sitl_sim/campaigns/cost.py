"""What a flight cost, and whose processor flew it: `worker.json` of a campaign's run folder."""

from __future__ import annotations

import json
import os
import resource
import socket
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

_FILE = "worker.json"


@dataclass(frozen=True)
class Cost:
    """Of one flight. worker: HOST:PID. version: of this package. wall_s, processor_s: s."""

    worker: str
    version: str
    wall_s: float
    processor_s: float


@contextmanager
def measured(folder: Path) -> Iterator[None]:
    """Write the cost of what is done meanwhile into the folder, where no error is raised."""
    started, used = time.monotonic(), _processor_seconds()
    yield
    cost = Cost(
        worker=f"{socket.gethostname()}:{os.getpid()}",
        version=version("swarm-companion"),
        wall_s=time.monotonic() - started,
        processor_s=_processor_seconds() - used,
    )
    (folder / _FILE).write_text(json.dumps(asdict(cost), indent=1), encoding="utf-8")


def cost_of(folder: Path) -> Cost | None:
    """Return what the flight of a run folder cost; None where it does not say."""
    try:
        return Cost(**json.loads((folder / _FILE).read_text("utf-8")))
    except (OSError, ValueError, TypeError):  # flown by an earlier version
        return None


def mean_cost(costs: Iterable[Cost | None]) -> dict[str, float | None]:
    """Return the mean times of a flight [s], and the flights that one core flies in an hour."""
    known = [c for c in costs if c is not None]
    if not known:
        return {"processor_s": None, "wall_s": None, "flights_per_core_hour": None}
    processor = sum(c.processor_s for c in known) / len(known)
    return {
        "processor_s": processor,
        "wall_s": sum(c.wall_s for c in known) / len(known),
        "flights_per_core_hour": 3600.0 / processor,
    }


def _processor_seconds() -> float:
    """Return what this process, and the processes that it has waited for, have used [s]."""
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)
