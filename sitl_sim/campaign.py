"""Many flights of one scenario, a seed each: flown by any executor, resumable, summed up.

A campaign's folder holds `campaign.json` (what was asked for), one run folder per seed, and in the
end `summary.json` and `campaign.html`. What is there already is not flown again; a run that was
cut off is flown anew.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

from mavlink_bridge.settings import SettingsError
from sitl_sim import scenario as scenarios
from sitl_sim.campaigns.run import Job, die_with_parent, fly, fly_away, metrics_of, unpack

REQUEST = "campaign.json"


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

    def begin(self) -> None:
        """Make the folder, or see that it holds flights of this very kind.

        Raises:
            SettingsError: it holds others; the settings that differ are named.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(self.folder / "unfinished", ignore_errors=True)
        asked = self.request()
        path = self.folder / REQUEST
        if path.exists():
            before = json.loads(path.read_text("utf-8"))
            if other := [k for k in asked if asked[k] != before.get(k)]:
                why = ", ".join(f"{k} {before.get(k)!r}, not {asked[k]!r}" for k in other)
                raise SettingsError([f"{self.folder}: holds another campaign ({why}); "
                                     "choose another --out"])  # fmt: skip
        path.write_text(json.dumps(asked, indent=1), encoding="utf-8")

    def request(self) -> dict[str, Any]:
        """What makes runs comparable: everything but how many, where and by whom."""
        asked = asdict(self)
        return {k: asked[k] for k in ("name", "scenario", "overrides")}


@contextmanager
def executor(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, bool]]:
    """Who flies, and whether that is elsewhere: local processes, or a Dask cluster's workers.

    Raises:
        SettingsError: no such cluster, or no Dask.
    """
    if scheduler is None:
        pool = ProcessPoolExecutor(workers, get_context("spawn"), die_with_parent)
        try:
            yield pool, False
        except BaseException:  # interrupted: a flight under way is flown anew, not waited for
            for worker in active_children():
                worker.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    try:
        import distributed
    except ImportError:
        raise SettingsError(
            ["--scheduler needs Dask: pip install 'swarm-companion[cluster]'"]
        ) from None
    connect: Any = distributed.Client
    try:
        client = connect(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise SettingsError([f"--scheduler {scheduler}: {error}"]) from error
    with client, client.get_executor(pure=False) as cluster:
        yield cluster, True


def run(
    campaign: Campaign, pool: Executor, elsewhere: bool, done: Callable[[int, str], None]
) -> dict[int, str]:
    """Fly what is missing; gives, by seed, why a flight could not be flown.

    done: told of each finished seed and of what came of it.
    """
    work: dict[Future[Any], Job] = {
        pool.submit(fly_away if elsewhere else fly, job): job for job in campaign.jobs()
    }
    broken: dict[int, str] = {}
    for future in as_completed(work):
        job = work[future]
        try:
            result = future.result()
        except Exception as error:  # whatever it was: one flight of many
            broken[job.seed] = " ".join(f"{type(error).__name__}: {error}".split())
            done(job.seed, broken[job.seed])
            continue
        if elsewhere:
            unpack(result, Path(job.folder))
        metrics = metrics_of(Path(job.folder))
        done(job.seed, "OK" if metrics and metrics["ok"] else "falls short")
    return broken
