"""Many flights of one scenario, a seed each: flown by any executor, resumable.

A campaign's folder holds `campaign.json` (its settings), one run folder per seed, and in the end
`summary.json` and `campaign.html`. A finished run is not flown again; a run that was cut off is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sitl_sim.campaigns.executors import JobExecutor
from sitl_sim.campaigns.run import Job, metrics_of
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import check_companions


@dataclass(frozen=True)
class Campaign:
    """`runs` seeds of a scenario from `first_seed` on, each flown into `folder`/NAME-SEED."""

    scenario: str
    overrides: list[str]
    runs: int
    first_seed: int
    folder: Path
    in_process: bool = False
    name: str = field(init=False)
    controllers: set[str] = field(init=False)

    def __post_init__(self) -> None:
        """Read the scenario, so that bad input shows before anything flies."""
        loaded = scenarios.load(self.scenario, [*self.overrides, f"seed={self.first_seed}"])
        check_companions(loaded, self.in_process)
        object.__setattr__(self, "name", loaded.name)
        object.__setattr__(self, "controllers", scenarios.controllers(loaded))

    @property
    def seeds(self) -> range:
        """The seed of each run."""
        return range(self.first_seed, self.first_seed + self.runs)

    def run_folder(self, seed: int) -> Path:
        """Return the run folder of a seed."""
        return self.folder / f"{self.name}-{seed}"

    def jobs(self) -> list[Job]:
        """Return the flights that are still missing."""
        changes = tuple(self.overrides)
        return [
            Job(self.scenario, changes, seed, str(self.run_folder(seed)), self.in_process)
            for seed in self.seeds
            if metrics_of(self.run_folder(seed)) is None
        ]

    def settings(self) -> dict[str, Any]:
        """Return what makes runs comparable: every setting but the seed and the ports."""
        written = scenarios.read(self.scenario, self.overrides)
        return written.model_dump(mode="json", exclude={"seed", "wire"})


def run(
    campaign: Campaign, executor: JobExecutor, done: Callable[[int, str], None]
) -> dict[int, str]:
    """Fly what is missing; return, by seed, why a flight could not be flown.

    done: called with each finished seed and its result.

    Where a worker dies, any of the flights under way may be the cause: each of them is flown once
    more, alone.
    """
    waiting, suspects = deque(campaign.jobs()), deque[Job]()
    flying: dict[Future[Any], tuple[Job, bool]] = {}  # the job, and whether it flies alone
    not_flown: dict[int, str] = {}
    while waiting or suspects or flying:
        alone = bool(suspects)
        died = False  # a worker, and its pool with it
        while (suspects or waiting) and len(flying) < (1 if alone else executor.slots) and not died:
            queue = suspects or waiting
            try:
                flying[executor.submit(queue[0])] = queue[0], alone
                queue.popleft()
            except BrokenExecutor:  # died between two flights
                died = True
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            job, alone = flying.pop(future)
            try:
                executor.store(job, future.result())
            except Exception as error:  # any error ends one flight, not the campaign
                if isinstance(error, BrokenExecutor):
                    died = True
                    if not alone:
                        suspects.append(job)
                        continue
                not_flown[job.seed] = _why(error)
                done(job.seed, not_flown[job.seed])
                continue
            metrics = metrics_of(Path(job.folder))
            done(job.seed, "OK" if metrics and metrics["ok"] else "falls short")
        if died:
            suspects.extend(job for job, _ in flying.values())
            flying.clear()
            executor.restart()
    return not_flown


def _why(error: Exception) -> str:
    """Return why a flight was not flown, as one line."""
    if isinstance(error, CancelledError):  # nobody here cancels a flight
        return "the scheduler was lost"
    return " ".join(f"{type(error).__name__}: {error}".split())
