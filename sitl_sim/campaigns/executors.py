"""Executors of a campaign's flights: processes on this machine, or a Dask cluster's workers."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, Protocol

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns.run import Job, fly, fly_to_archive, set_up_worker, unpack

_ANY_NUMBER = 1_000_000


class JobExecutor(Protocol):
    """Flies jobs; slots: the number of jobs that it takes at a time."""

    slots: int

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job."""
        ...

    def store(self, job: Job, result: Any) -> None:
        """Put the result of a flight into the job's run folder."""
        ...

    def restart(self) -> None:
        """Make ready for further jobs after a worker has died."""
        ...


class ProcessJobs:
    """One process for each flight under way; the processes end with this one."""

    def __init__(self, workers: int) -> None:
        self.slots = workers
        self.restart()

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job."""
        return self._pool.submit(fly, job)

    def store(self, job: Job, result: Any) -> None:
        """Do nothing: the worker has written the run folder."""

    def restart(self) -> None:
        """Start new processes: a pool whose worker has died takes no more work."""
        self._pool = ProcessPoolExecutor(self.slots, get_context("spawn"), set_up_worker)

    def close(self) -> None:
        """End the processes; flights under way are flown again another time."""
        for worker in active_children():
            worker.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


class DaskJobs:
    """The workers of a Dask cluster; its scheduler distributes the flights."""

    slots = _ANY_NUMBER

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def submit(self, job: Job) -> Future[Any]:
        """Begin to fly a job on one of the workers."""
        return self._executor.submit(fly_to_archive, job)

    def store(self, job: Job, result: bytes) -> None:
        """Unpack the run folder that the worker returned."""
        unpack(result, Path(job.folder))

    def restart(self) -> None:
        """Do nothing: the scheduler restarts its workers."""


@contextmanager
def job_executor(workers: int, scheduler: str | None) -> Iterator[JobExecutor]:
    """Yield local processes, or the cluster of the scheduler at this address.

    Raises:
        SettingsError: the scheduler does not answer.
    """
    if scheduler is None:
        processes = ProcessJobs(workers)
        try:
            yield processes
        finally:
            processes.close()
        return
    import distributed

    connect: Any = distributed.Client
    try:
        client = connect(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise SettingsError([f"--scheduler {scheduler}: {error}"]) from error
    with client:
        executor = client.get_executor(pure=False)
        try:
            yield DaskJobs(executor)
        finally:
            executor.shutdown(wait=False)  # interrupted: queued flights are not waited for
