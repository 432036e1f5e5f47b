"""The board itself: software, speed, disk, permissions."""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from companion.control.nmpc import Nmpc
from companion.control.nmpc.instance_file import load, stored
from companion.doctor.finding import Finding, Level, either, rated
from companion.perception.camera import CalibrationError
from companion.perception.detectors import ModelError
from companion.perception.frontend import PerceptionFrontend, make_view
from companion.process.directories import log_path
from companion.process.signing_keys import SigningKeyError, read_key
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.link import parse_endpoint
from mavlink_bridge.wire.messages import VehicleState
from mavlink_bridge.wire.video import Frame

LIBRARIES = ("numpy", "casadi", "opencv-python-headless", "pydantic")
_SOLVES, _FRAMES = 100, 10
_LOG_PER_HOUR = 200e6  # bytes, flight log and .tlog
_GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")


def examine(config: CompanionConfig) -> Iterator[Finding]:
    """Return all findings about this machine."""
    yield _software()
    yield from _speed(config)
    yield from _governor()
    yield _logs(config)
    yield from _serial_port(config)
    yield from _signing_key(config)


def _software() -> Finding:
    said = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return Finding("software", Level.GREEN, f"Python {platform.python_version()}, {said}")


def _speed(config: CompanionConfig) -> Iterator[Finding]:
    """Measure a tick: recorded instances through the solver, noise through the detectors."""
    todo = "install gcc (the first start compiles the solver's kernel, once), or a released wheel"
    try:
        nmpc = Nmpc(config.nmpc, time.perf_counter)
    except ModuleNotFoundError as error:
        text = f"no C compiler, and {error.name} is not installed"
        yield Finding("solver", Level.RED, text, todo)
        return
    yield either("solver", nmpc.backend == "compiled", nmpc.backend, todo, Level.AMBER)
    instances = [i for run in load(stored(), config.nmpc) for i in run.instances][:_SOLVES]
    solve = float(np.percentile([nmpc.solve(i).solve_time for i in instances], 99))
    try:
        tick = solve + _perception_time(config)
    except (CalibrationError, ModelError) as error:
        yield Finding("speed", Level.AMBER, f"not measured: {error}", "correct that first")
        return
    text = (
        f"{tick * 1e3:.0f} ms a tick (solver p99 {solve * 1e3:.1f} ms) "
        f"of {config.timing.period * 1e3:.0f} ms"
    )
    limits = (0.5 * config.timing.period, 0.8 * config.timing.period)
    yield rated("speed", tick, limits, text, "faster board, smaller camera frames, fewer processes")


def _perception_time(config: CompanionConfig) -> float:
    """Return the time [s] that perception takes for a frame of coloured noise, a hard one.

    Raises:
        CalibrationError, ModelError: a file that perception needs cannot be used.
    """
    view = make_view(config.camera, config.sensing)
    frontend = PerceptionFrontend(view, config.sensing, config.camera_health)
    shape = (config.camera.height, config.camera.width, 3)
    image = np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)
    own = VehicleState(
        0.0, np.array([0, 0, 2.0]), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3)
    )
    taken = []
    for n in range(_FRAMES):
        started = time.perf_counter()
        frame = Frame(float(n), {"image": np.roll(image, n, axis=1)})  # equal ones are a fault
        frontend.see(float(n), frame, lambda time: replace(own, time=time))
        taken.append(time.perf_counter() - started)
    return float(np.median(taken))


def _governor() -> Iterator[Finding]:
    if _GOVERNOR.exists():
        governor = _GOVERNOR.read_text().strip()
        todo = "echo performance into scaling_governor of every CPU: other governors react late"
        yield either("cpu governor", governor == "performance", governor, todo, Level.AMBER)


def _logs(config: CompanionConfig) -> Finding:
    if config.log.path is None:
        return Finding("log", Level.AMBER, "no flight log", "give log.path")
    folder = log_path(config.log.path, os.environ).resolve().parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return Finding(
            "log", Level.RED, f"{folder} cannot be written to", "create it, or change its owner"
        )
    hours = shutil.disk_usage(folder).free / _LOG_PER_HOUR
    text = f"{folder}: room for {hours:.0f} h of flight"
    return rated("log", -hours, (-4.0, -1.0), text, "remove old flight logs")


def _serial_port(config: CompanionConfig) -> Iterator[Finding]:
    kind, device, _ = parse_endpoint(config.link.endpoint)
    if kind != "serial":
        return
    path = Path(device)
    if not path.exists():
        todo = "plug the autopilot in; `ls /dev/serial/by-id` lists the ports"
        yield Finding("serial port", Level.RED, f"{device} is not there", todo)
    else:
        todo = f"sudo usermod -a -G {path.group()} {os.environ.get('USER', 'USER')}; log in again"
        allowed = os.access(path, os.R_OK | os.W_OK)
        yield either("serial port", allowed, f"{device} of group {path.group()}", todo)


def _signing_key(config: CompanionConfig) -> Iterator[Finding]:
    """Examine whether the service can sign."""
    if config.link.signing is None:
        return
    key = config.link.signing.key
    if "/" not in key and not Path(key).exists():
        text = f"{key}: a credential of the service, which only the service can read"
        yield Finding("signing key", Level.AMBER, text, "LoadCredential= must name it")
        return
    try:
        read_key(Path(key))
    except SigningKeyError as error:
        yield Finding("signing key", Level.RED, str(error), "the daemon does not start without it")
    else:
        yield Finding("signing key", Level.GREEN, key)
