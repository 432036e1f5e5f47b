"""The cost of each of ten daemons that fly together in real time: a table for the docs.

    python -m tests.benchmarks.ten_daemons [SECONDS] [KEY=VALUE ...]

They fly `crossing` with perfect sensing, so that the daemons' share is tracking and planning, not
a camera's image. Further arguments are the flight's `--set`. CPU and memory are read from /proc
once a second, from `START` seconds after all ten run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

DRONES = 10
START = 8.0  # s of imports and take-off, not counted
TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
SENSING = ("sensing.neighbours=truth", "sensing.obstacles=map")


def companions(parent: int) -> list[Path]:
    """Return the /proc folders of the daemons that `parent` started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            command = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:  # ended meanwhile
            continue
        if int(fields[1]) == parent and b"companion" in command:
            found.append(folder)
    return found


def used(folder: Path) -> tuple[float, float]:
    """Return the CPU time [s] and resident memory [MB] of a process."""
    fields = (folder / "stat").read_text().rpartition(")")[2].split()
    status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
    cpu = (int(fields[11]) + int(fields[12])) / TICKS_PER_SECOND
    return cpu, float(status["VmRSS"].split()[0]) / 1024


def watch(flight: subprocess.Popen[bytes]) -> tuple[list[float], list[float]]:
    """Return the share of a core [%] and the most memory [MB] of each daemon in the flight."""
    first: dict[Path, float] = {}
    share, memory = {}, {}
    began = 0.0
    while flight.poll() is None:
        time.sleep(1.0)
        there = companions(flight.pid)
        if not first and len(there) < DRONES:
            continue
        for folder in there:
            try:
                cpu, resident = used(folder)
            except (OSError, KeyError):  # it is just ending
                continue
            began = began or time.monotonic()
            flown = time.monotonic() - began - START
            if flown > 1.0:
                share[folder] = 100.0 * (cpu - first[folder]) / flown
            elif flown < 0.0:
                first[folder] = cpu
            memory[folder] = max(resident, memory.get(folder, 0.0))
    return [*share.values()], [*memory.values()]


def main(seconds: float, changes: list[str]) -> None:
    """Fly, watch, print."""
    with tempfile.TemporaryDirectory() as folder:
        settings = (f"mission.time_limit={seconds}", *SENSING, *changes)
        overrides = [part for setting in settings for part in ("--set", setting)]
        arguments = ["run", "crossing", "--real-time", "--out", folder, *overrides]
        flight = subprocess.Popen(
            [sys.executable, "-m", "sitl_sim", *arguments], stdout=subprocess.DEVNULL
        )
        share, memory = watch(flight)
        metrics = json.loads((Path(folder) / "metrics.json").read_text())
    print("| daemon | solve p50 ms | p99 | max | tick p99 ms | late ticks |")
    print("|---|---|---|---|---|---|")
    for name, drone in metrics["per_drone"].items():
        solve, tick = drone["solve_ms"], drone["tick_ms"]
        cells = (solve["p50"], solve["p99"], solve["max"], tick["p99"])
        numbers = " | ".join(f"{cell:.2f}" for cell in cells)
        print(f"| {name} | {numbers} | {drone['deadline_misses']} |")
    print(
        f"\n{len(share)} daemons: {min(share):.1f} to {max(share):.1f} % of a core, "
        f"at most {max(memory):.0f} MB each"
    )


if __name__ == "__main__":
    numbers = [argument for argument in sys.argv[1:] if "=" not in argument]
    main(
        float(numbers[0]) if numbers else 40.0,
        [argument for argument in sys.argv[1:] if "=" in argument],
    )
