"""A Dask cluster on this machine: scheduler and workers are processes, as on any other."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time


def until(happened, seconds=120.0):
    """Wait until the function returns something true."""
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


class Cluster:
    """A scheduler; workers come by `join` and go by `kill`. environment: for all of them."""

    def __init__(self, folder, **environment):
        self.folder = folder
        self.environment = os.environ | environment
        self.workers = []
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", folder, "--port", "0")
        until(self.file.exists)
        self.address = json.loads(self.file.read_text())["address"]

    def join(self):
        """Start one more worker, and return it; it flies in a folder of its own."""
        place = self.folder / f"worker{len(self.workers)}"
        place.mkdir()
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(place / "dask")]
        worker = self._start("worker", place, *options)
        worker.place = place
        self.workers.append(worker)
        return worker

    def kill_in_flight(self, worker):
        """Kill a worker that is in the middle of a flight."""
        until(lambda: _flies_in(worker.place))
        worker.send_signal(signal.SIGKILL)
        worker.wait()

    def _start(self, what, place, *options):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard"]
        command += ["--scheduler-file", str(self.file), *options]
        return subprocess.Popen(command, env=self.environment | {"TMPDIR": str(place)})

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def _flies_in(place):
    with contextlib.suppress(FileNotFoundError):  # the flight ended while it was looked for
        return any(place.glob("*/unfinished/*/world.json"))
    return False
