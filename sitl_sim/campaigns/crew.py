"""Who flies a campaign's flights: processes on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, Protocol

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns.run import Job, die_with_parent, fly, fly_away, unpack

_ANY_NUMBER = 1_000_000


class Crew(Protocol):
    """Flies jobs. places: how many it is given at a time."""

    places: int

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job."""
        ...

    def bring(self, job: Job, result: Any) -> None:
        """Put what a flight came to where it belongs."""
        ...

    def renew(self) -> None:
        """Go on after a worker has died."""
        ...


class Processes:
    """A process for each flight under way; they end with this one."""

    def __init__(self, workers: int) -> None:
        self.places = workers
        self.renew()

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job."""
        return self._pool.submit(fly, job)

    def bring(self, job: Job, result: Any) -> None:
        """It is there already."""

    def renew(self) -> None:
        """New processes: a pool of which one has died takes no more work."""
        self._pool = ProcessPoolExecutor(self.places, get_context("spawn"), die_with_parent)

    def leave(self) -> None:
        """End them; a flight under way is flown anew another time, not waited for."""
        for worker in active_children():
            worker.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


class Cluster:
    """The workers of a Dask cluster; the scheduler shares the flights out."""

    places = _ANY_NUMBER

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job, somewhere."""
        return self._executor.submit(fly_away, job)

    def bring(self, job: Job, result: bytes) -> None:
        """Unpack the run folder that came."""
        unpack(result, Path(job.folder))

    def renew(self) -> None:
        """The scheduler sees to it."""


@contextmanager
def crew(workers: int, scheduler: str | None) -> Iterator[Crew]:
    """Local processes, or the cluster of the scheduler named.

    Raises:
        SettingsError: no such cluster, or no Dask.
    """
    if scheduler is None:
        processes = Processes(workers)
        try:
            yield processes
        finally:
            processes.leave()
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
    with client:
        executor = client.get_executor(pure=False)
        try:
            yield Cluster(executor)
        finally:
            executor.shutdown(wait=False)  # interrupted: what is queued there is not waited for
