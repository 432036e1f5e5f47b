"""The units of a board's drones: which are armed, restarts, and whether they stay up.

Like `installer.py` it runs on the board, and needs only Python itself.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import time
from collections.abc import Iterable
from pathlib import Path

from .changes import InstallError, Report, run

RUN = "run/swarm-companion"
START_WITHIN = 20.0  # s to see whether a restarted daemon stays up
_POLL = 0.2  # s between two looks at a unit


class Services:
    """The service manager of the board whose file system lies below `root`.

    systemctl: the command; None where no systemd runs there (images, tests).
    """

    def __init__(self, root: Path, report: Report, systemctl: list[str] | None) -> None:
        self._root = root
        self._report = report
        self._systemctl = systemctl
        self._restarted: list[str] = []

    @property
    def present(self) -> bool:
        """Whether systemd runs there."""
        return self._systemctl is not None

    def refuse_while_armed(self) -> None:
        """Leave a board alone whose drone may fly.

        Raises:
            InstallError: a daemon there says that its vehicle is armed.
        """
        for name, phase in self._armed().items():
            raise InstallError(f"{name} is armed ({phase})")

    def reload(self) -> None:
        """Make systemd and udev read their files anew; the rule also holds for what is plugged in.

        udev is the running system's alone.
        """
        self._ask("daemon-reload")
        udevadm = shutil.which("udevadm")
        if udevadm is not None and self._root == Path("/"):
            run([udevadm, "control", "--reload"])
            run([udevadm, "trigger", "--subsystem-match=tty"])

    def restart(self, unit: str) -> None:
        """Restart a unit and wait until it is up.

        Raises:
            InstallError: a drone is armed by now, or the unit does not stay up.
        """
        self.refuse_while_armed()  # the restart before this one took its time
        before = self._show(unit).get("InvocationID", "")
        self._restarted.append(unit)
        self._ask("restart", "--no-block", unit)
        self._wait_until_up(unit, before)
        self._report.add("restart", unit)

    def restart_anew(self) -> None:
        """Restart every unit once more, after its files were put back; armed drones are left."""
        if self._restarted:
            self._ask("daemon-reload")
        for unit in self._restarted:
            if unit.partition("@")[2].removesuffix(".service") in self._armed():
                self._report.note("restart", f"{unit} is armed by now and runs on as it is")
            else:
                self._ask("restart", "--no-block", unit)

    def running(self, names: Iterable[str]) -> list[str]:
        """Return the units that run for these drones."""
        units = [f"{kind}@{n}.service" for n in names for kind in ("mavlink-bridge", "companion")]
        return [unit for unit in units if _runs(self._show(unit))]

    def _wait_until_up(self, unit: str, before: str) -> None:
        """Wait for a new invocation of the unit; `before` is the id of the old one.

        Raises:
            InstallError: it failed, or did not come as far as waiting for its vehicle.
        """
        deadline = time.monotonic() + START_WITHIN
        while time.monotonic() < deadline:
            state = self._show(unit)
            if state.get("InvocationID", "") != before:
                if _failed(state):
                    raise InstallError(f"{unit} does not start: see `journalctl -u {unit}`")
                if _up(state):
                    return
            time.sleep(_POLL)
        raise InstallError(f"{unit} did not start within {START_WITHIN:.0f} s")

    def _armed(self) -> dict[str, str]:
        """Return the phase of each drone whose daemon says that its vehicle is armed."""
        armed = {}
        for file in sorted((self._root / RUN).glob("*/state.json")):
            with contextlib.suppress(OSError, ValueError):
                state = json.loads(file.read_text())
                if state.get("armed") and Path(f"/proc/{state.get('pid')}").exists():
                    armed[file.parent.name] = str(state.get("phase"))
        return armed

    def _show(self, unit: str) -> dict[str, str]:
        """Return the properties of a unit."""
        shown = self._ask("show", "-p", "ActiveState,SubState,StatusText,InvocationID", unit)
        return dict(line.split("=", 1) for line in shown.splitlines() if "=" in line)

    def _ask(self, *arguments: str) -> str:
        assert self._systemctl is not None
        return run([*self._systemctl, *arguments])


def _failed(state: dict[str, str]) -> bool:
    return state.get("ActiveState") == "failed" or state.get("SubState") == "auto-restart"


def _runs(state: dict[str, str]) -> bool:
    return state.get("ActiveState") in ("active", "activating") and not _failed(state)


def _up(state: dict[str, str]) -> bool:
    """Return whether a unit is ready, or waits for its autopilot or camera."""
    active, text = state.get("ActiveState"), state.get("StatusText", "")
    return active == "active" or (active == "activating" and "waiting for" in text)
