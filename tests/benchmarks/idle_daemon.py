"""The cost of a daemon that waits on the ground for a pilot: figures for the docs.

    python -m tests.benchmarks.idle_daemon [SECONDS] [TIMES]

Beside it runs an emulated PX4 in real time, with its telemetry and a small camera. Processor time,
context switches and memory are those of the daemon alone, from /proc; it is measured from `SETTLE`
seconds after READY on. Other work on the machine makes them larger: compare in turn.
"""

from __future__ import annotations

import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.companion.conftest import DRONE, SCENARIO
from tests.companion.deployment import free_ports

SETTLE = 8.0  # s; a daemon rests after five
PATIENCE = 60.0  # s for the world, and for READY


def main(seconds: float, times: int) -> None:
    """Start the world once, and a daemon `times` times; print a line for each."""
    with tempfile.TemporaryDirectory() as name:
        folder, base = Path(name), free_ports(12)
        scenario, drone = folder / "served.yaml", folder / "drone1.yaml"
        parameters = {"autopilot": "px4", "parameters": "{}"}
        scenario.write_text(SCENARIO.format(p=base, f=base + 4, g=base + 9, **parameters))
        drone.write_text(DRONE.format(i=1, port=base + 1, frames=base + 5, auto="false"))
        command = [sys.executable, "-m", "sitl_sim", "serve", str(scenario)]
        with subprocess.Popen(
            [*command, "--out", str(folder / "run")],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as world:
            try:
                _wait_for_listener(base + 5)
                for n in range(times):
                    print(_one(drone, folder / f"state{n}", seconds), flush=True)
            finally:
                world.kill()


def _wait_for_listener(port: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while f"0100007F:{port:04X} 00000000:0000 0A" not in Path("/proc/net/tcp").read_text():
        if time.monotonic() > deadline:
            raise TimeoutError("the world did not start")
        time.sleep(0.05)


def _one(drone: Path, folder: Path, seconds: float) -> str:
    """Return a line of figures of one daemon."""
    folder.mkdir()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notices:
        notices.bind(str(folder / "notify"))
        notices.settimeout(PATIENCE)
        names = ("RUNTIME_DIRECTORY", "LOGS_DIRECTORY", "STATE_DIRECTORY")
        environment = os.environ | dict.fromkeys(names, str(folder))
        environment |= {"NOTIFY_SOCKET": str(folder / "notify"), "WATCHDOG_USEC": "1000000"}
        began = time.monotonic()
        command = [sys.executable, "-m", "companion", "run", str(drone)]
        with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as daemon:
            while b"READY=1" not in notices.recv(4096):
                pass
            ready, cpu = time.monotonic() - began, _cpu(daemon.pid)
            _listen(notices, SETTLE)
            before, woken, began = _cpu(daemon.pid), _woken(daemon.pid), time.monotonic()
            fed = _listen(notices, seconds)
            passed = time.monotonic() - began
            share = 100.0 * (_cpu(daemon.pid) - before) / passed
            woken = round((_woken(daemon.pid) - woken) / passed)
            memory = _memory(daemon.pid)
            daemon.send_signal(signal.SIGTERM)
    return (
        f"READY after {ready:.2f} s, {cpu:.2f} s of them processor time; then {share:.2f} % of a "
        f"core, woken {woken} and its watchdog fed {fed / passed:.1f} times a second; {memory}"
    )


def _listen(notices: socket.socket, seconds: float) -> int:
    """Return how often the watchdog was fed in so many seconds."""
    fed, end = 0, time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        if select.select([notices], [], [], left)[0]:
            fed += b"WATCHDOG=1" in notices.recv(4096)
    return fed


def _cpu(pid: int) -> float:
    """Return the processor time [s] of all threads that run, to the nanosecond."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((t / "schedstat").read_text().split()[0]) for t in threads) / 1e9


def _woken(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("\nvoluntary_ctxt_switches:")[1].split()[0])


def _memory(pid: int) -> str:
    """Return the memory [MB] that is resident, its share of what is used by several, the most."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text() + Path(f"/proc/{pid}/status").read_text()
    most, now, share = (
        int(re.search(rf"^{name}:\s+(\d+)", text, re.M)[1]) / 1e3  # type: ignore[index]
        for name in ("VmHWM", "Rss", "Pss")
    )
    return f"{now:.0f} MB resident ({share:.0f} proportional, {most:.0f} at most)"


if __name__ == "__main__":
    numbers = [float(argument) for argument in sys.argv[1:]]
    main(numbers[0] if numbers else 20.0, int(numbers[1]) if len(numbers) > 1 else 1)
