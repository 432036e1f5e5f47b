"""A world served by `sitl-sim serve` in a process of its own, as users serve it."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENARIO = """
fileversion: 1
name: wire
drones: {{count: {count}, autopilot: {autopilot}, jitter: 0.0, spacing: 4.0}}
mission: {{home: false, targets: [[0, 0, 2]], time_limit: 3600.0}}
sensing: {{neighbours: truth, obstacles: map}}
wire: {{companion_port: {companion}, gcs_port: {gcs}, frame_port: {frames}}}
"""


def free_ports(count, kind=socket.SOCK_DGRAM):
    """Return a port p so that p … p + count are free now."""
    for first in range(20000 + os.getpid() % 5000, 60000, count + 1):
        sockets = []
        try:
            for port in range(first, first + count + 1):
                sockets.append(socket.socket(socket.AF_INET, kind))
                sockets[-1].bind(("127.0.0.1", port))
        except OSError:
            continue
        finally:
            for s in sockets:
                s.close()
        return first
    raise OSError("no free ports")


class Lines:
    """The growing output of a process."""

    def __init__(self, stream):
        self.text = ""
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, args=(stream,), daemon=True)
        self._thread.start()

    def _read(self, stream):
        with stream:
            for character in iter(lambda: stream.read(1), ""):
                with self._changed:
                    self.text += character
                    self._changed.notify_all()

    def join(self):
        """Wait until the stream has ended."""
        self._thread.join()

    def wait_for(self, pattern, since=0, timeout=90.0):
        """Wait for and return the first match of a pattern after `since` characters."""
        end = time.monotonic() + timeout
        with self._changed:
            while (found := re.compile(pattern).search(self.text, since)) is None:
                if not self._changed.wait(end - time.monotonic()):
                    raise TimeoutError(f"no {pattern!r} in:\n{self.text[since:][-3000:]}")
        return found


class Served:
    """Ports and process of a served world."""

    def __init__(self, companion, gcs, process):
        self.companion, self.gcs, self.process = companion, gcs, process

    def urls(self, count):
        """Return MAVSDK's URLs of the companion ports."""
        return [f"udpin://127.0.0.1:{self.companion + i + 1}" for i in range(count)]


@contextlib.contextmanager
def served(autopilot, count=1, **keys):
    """Serve `count` vehicles; keys: further scenario values by dotted path, `__` for the dot."""
    companion, frames = free_ports(count), free_ports(count, socket.SOCK_STREAM)
    gcs = free_ports(1)
    overrides = [f"--set={k.replace('__', '.')}={v}" for k, v in keys.items()]
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "wire.yaml"
        scenario.write_text(
            SCENARIO.format(
                count=count, autopilot=autopilot, companion=companion, gcs=gcs, frames=frames
            )
        )
        process = subprocess.Popen(
            [sys.executable, "-m", "sitl_sim", "serve", str(scenario), "--out", folder, *overrides],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        lines = Lines(process.stderr)
        try:
            lines.wait_for(rf"drone{count}: system {count}, companion UDP")
            yield Served(companion, gcs, process)
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=20)
            lines.join()
