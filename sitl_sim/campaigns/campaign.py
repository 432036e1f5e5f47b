"""Many flights of one scenario, a seed each: flown by any executor, resumable, summed up.

A campaign's folder holds `campaign.json` (what was asked for), one run folder per seed, and in the
end `summary.json` and `campaign.html`. What is there already is not flown again; a run that was
cut off is flown anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sitl_sim.campaigns.crew import Crew
from sitl_sim.campaigns.run import Job, metrics_of
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import check_companions


@dataclass(frozen=True)
class Campaign:
    """What is to be flown: `runs` seeds from `first_seed` on, each into `folder`/NAME-SEED."""

    scenario: str
    overrides: list[str]
    runs: int
    first_seed: int
    folder: Path
    in_process: bool = False
    name: str = field(init=False)

    def __post_init__(self) -> None:
        """Read the scenario: bad input shows here, before anything flies."""
        loaded = scenarios.load(self.scenario, [*self.overrides, f"seed={self.first_seed}"])
        check_companions(loaded, self.in_process)
        object.__setattr__(self, "name", loaded.name)

    @property
    def seeds(self) -> range:
        """One for each run."""
        return range(self.first_seed, self.first_seed + self.runs)

    def run_folder(self, seed: int) -> Path:
        """Where a seed's flight is."""
        return self.folder / f"{self.name}-{seed}"

    def jobs(self) -> list[Job]:
        """The flights that are still missing."""
        return [
            Job(self.scenario, tuple(self.overrides), seed, str(self.run_folder(seed)),
                self.in_process)
            for seed in self.seeds if metrics_of(self.run_folder(seed)) is None
        ]  # fmt: skip

    def settings(self) -> dict[str, Any]:
        """What makes runs comparable: every setting but the seed and the ports."""
        written = scenarios.read(self.scenario, self.overrides)
        return written.model_dump(mode="json", exclude={"seed", "wire"})


def run(campaign: Campaign, crew: Crew, done: Callable[[int, str], None]) -> dict[int, str]:
    """Fly what is missing; gives, by seed, why a flight could not be flown.

    done: told of each finished seed and of what came of it.

    Where a worker dies, nobody knows by whose fault: what was flying flies once more, each alone.
    """
    waiting, suspects = deque(campaign.jobs()), deque[Job]()
    flying: dict[Future[Any], tuple[Job, bool]] = {}  # and whether it flies alone
    broken: dict[int, str] = {}
    while waiting or suspects or flying:
        alone = bool(suspects)
        died = False  # a worker, and its pool with it
        while (suspects or waiting) and len(flying) < (1 if alone else crew.places) and not died:
            queue = suspects or waiting
            try:
                flying[crew.submit(queue[0])] = queue[0], alone
                queue.popleft()
            except BrokenExecutor:  # between two flights
                died = True
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            job, alone = flying.pop(future)
            try:
                crew.bring(job, future.result())
            except Exception as error:  # whatever it was: one flight of many
                if isinstance(error, BrokenExecutor):
                    died = True
                    if not alone:
                        suspects.append(job)
                        continue
                broken[job.seed] = " ".join(f"{type(error).__name__}: {error}".split())
                done(job.seed, broken[job.seed])
                continue
            metrics = metrics_of(Path(job.folder))
            done(job.seed, "OK" if metrics and metrics["ok"] else "falls short")
        if died:
            suspects.extend(job for job, _ in flying.values())
            flying.clear()
            crew.renew()
    return broken
