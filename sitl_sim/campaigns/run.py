"""One run of a campaign, as a function that any executor can call: in a process, on a cluster."""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import os
import shutil
import signal
import tarfile
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mavlink_bridge.shared.settings import SettingsError

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass(frozen=True)
class Job:
    """One flight: the scenario with its overrides, its seed, and where its folder is to be."""

    scenario: str
    overrides: tuple[str, ...]
    seed: int
    folder: str
    in_process: bool = False


def die_with_parent() -> None:
    """Let the kernel end this process when the one that started it ends, however it does."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def fly(job: Job) -> None:
    """Fly a job into its folder. A folder is whole or it is not there.

    Raises:
        SettingsError, EndpointError, VideoError: bad input.
        RuntimeError: a companion did not start; with the end of what it printed.
    """
    with _whole(Path(job.folder)) as unfinished:
        _fly(job, unfinished)


def fly_away(job: Job) -> bytes:
    """Fly a job on whatever machine this is; gives its folder as a tar archive."""
    with tempfile.TemporaryDirectory() as place:
        fly(replace(job, folder=f"{place}/run"))
        archive = io.BytesIO()
        with tarfile.open(fileobj=archive, mode="w:gz", compresslevel=1) as tar:
            tar.add(f"{place}/run", arcname=".")
        return archive.getvalue()


def unpack(archive: bytes, folder: Path) -> None:
    """Write a folder that came from elsewhere; whole or not at all."""
    stream = io.BytesIO(archive)
    with _whole(folder) as unfinished, tarfile.open(fileobj=stream, mode="r:gz") as tar:
        tar.extractall(unfinished, filter="data")


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A place to write a folder's contents; they become the folder when all is well."""
    unfinished = folder.parent / "unfinished" / f"{folder.name}-{os.getpid()}"
    shutil.rmtree(unfinished, ignore_errors=True)
    yield unfinished
    shutil.rmtree(folder, ignore_errors=True)
    unfinished.rename(folder)
    with contextlib.suppress(OSError):  # another run is not finished yet
        unfinished.parent.rmdir()


def _fly(job: Job, folder: Path) -> None:
    import cv2

    from sitl_sim.flight.results import finish
    from sitl_sim.flight.runner import flight
    from sitl_sim.recording.code_version import commit
    from sitl_sim.scenarios import scenario as scenarios

    cv2.setNumThreads(1)
    commit()  # looked up now: what is committed during the flight did not fly
    wanted = [*job.overrides, f"seed={job.seed}"]
    started = time.monotonic()
    with _ports(job, scenarios.load(job.scenario, wanted).drones.count) as ports:
        scenario = scenarios.load(job.scenario, [*wanted, *ports])
        with flight(scenario, folder, in_process=job.in_process) as f:
            f.write_inputs()
            f.launch()
            f.wait_for_companions()
            ready = time.monotonic() - started
            f.run()
    finish(f, ready, report="on failure")


@contextmanager
def _ports(job: Job, drones: int) -> Iterator[list[str]]:
    """Overrides that keep this flight's ports apart from all others'."""
    from sitl_sim.campaigns import ports

    if job.in_process:
        yield []
        return
    with ports.block(drones) as base:
        yield ports.overrides(base, drones)


def metrics_of(folder: Path) -> dict[str, Any] | None:
    """What a finished run wrote down; None where there is none.

    Raises:
        SettingsError: a file that no run wrote.
    """
    path = folder / "metrics.json"
    try:
        if not path.exists():
            return None
        # Earlier versions wrote Infinity where nobody flew at the same time.
        return dict(json.loads(path.read_text("utf-8"), parse_constant=lambda _: None))
    except (OSError, ValueError, TypeError) as error:
        raise SettingsError([f"{path}: not what a run wrote: {error}"]) from error
