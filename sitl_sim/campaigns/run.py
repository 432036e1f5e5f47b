"""One run of a campaign as a function that any executor can call, in a process or on a cluster."""

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

from mavlink_bridge.shared.archives import extract
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns.cost import measured

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass(frozen=True)
class Job:
    """One flight: the scenario with its overrides, its seed, and its run folder."""

    scenario: str
    overrides: tuple[str, ...]
    seed: int
    folder: str
    in_process: bool = False


def set_up_worker() -> None:
    """Let the kernel end this process with its parent, and leave Ctrl-C to the parent."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def fly(job: Job) -> None:
    """Fly a job into its folder, which then is whole or does not exist.

    Raises:
        SettingsError, EndpointError, VideoError: bad input.
        RuntimeError: a companion did not start; with the end of its output.
    """
    with _whole(Path(job.folder)) as unfinished, measured(unfinished):
        _fly(job, unfinished)


def fly_to_archive(job: Job) -> bytes:
    """Fly a job on the machine of a cluster; return its folder as a tar archive."""
    with tempfile.TemporaryDirectory() as place:
        fly(replace(job, folder=f"{place}/run"))
        archive = io.BytesIO()
        with tarfile.open(fileobj=archive, mode="w:gz", compresslevel=1) as tar:
            tar.add(f"{place}/run", arcname=".")
        return archive.getvalue()


def unpack(archive: bytes, folder: Path) -> None:
    """Write a folder from its tar archive, whole or not at all."""
    stream = io.BytesIO(archive)
    with _whole(folder) as unfinished, tarfile.open(fileobj=stream, mode="r:gz") as tar:
        unfinished.mkdir(parents=True)
        extract(tar, (m for m in tar if not m.isdir()), unfinished)


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """Yield a place for a folder's contents; they become the folder where no error is raised."""
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
    commit()  # looked up now: a commit made during the flight did not fly
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
    finish(f, ready, of_campaign=True)


@contextmanager
def _ports(job: Job, drones: int) -> Iterator[list[str]]:
    """Yield overrides that keep this flight's ports apart from those of all others."""
    from sitl_sim.campaigns import ports

    if job.in_process:
        yield []
        return
    with ports.block(drones) as base:
        yield ports.overrides(base, drones)


def metrics_of(folder: Path) -> dict[str, Any] | None:
    """Return the metrics of a finished run; None where there are none.

    Raises:
        SettingsError: no run wrote the file.
    """
    path = folder / "metrics.json"
    try:
        if not path.exists():
            return None
        # Earlier versions wrote Infinity where no two drones flew at the same time.
        return dict(json.loads(path.read_text("utf-8"), parse_constant=lambda _: None))
    except (OSError, ValueError, TypeError) as error:
        raise SettingsError([f"{path}: not what a run wrote: {error}"]) from error
