"""Installs a bundle below a root directory; runs on the board, needs only Python itself.

    python3 BUNDLE BUNDLE --root / [--dry-run] [--rollback]

Releases lie side by side, and `current` is a link: an upgrade that fails changes nothing, the old
release goes on running, and the one before stays for `--rollback`. Configuration that was edited on
the board is kept. What a loss of power leaves half done is put back at the next start of the board
(`journal.py`). The last line printed is the report, as JSON.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from . import journal
from .account import installing_user
from .changes import Changes, InstallError, Report, User, link_target, sha256
from .journal import HOME, JOURNAL, LOCK
from .release import check_configurations, make_release
from .services import Services

CONFIG = "etc/swarm-companion"
SIGNERS = f"{CONFIG}/signers"
WANTS = "etc/systemd/system/swarm.target.wants"
# Written before all else, and never put back: what puts the rest back.
RECOVERY = (f"{HOME}/recover.py", "etc/systemd/system/swarm-recover.service")
RECOVERY_LINK = "etc/systemd/system/sysinit.target.wants/swarm-recover.service"
Plan = dict[str, Any]  # plan.json of a bundle


class Board:
    """A board's file system below `root`, and its services."""

    def __init__(
        self, root: Path, report: Report, systemctl: list[str] | None, user: User | None = None
    ) -> None:
        """Take charge of a board.

        systemctl: the command, or None where no systemd runs there (images, tests). user: who runs
        what packages bring; None: this process's user.
        """
        self.root = root
        self._user = user
        self.home = root / HOME
        self.report = report
        self._services = Services(root, report, systemctl)
        self._changes = Changes(root)
        self._switched = False

    def install(self, bundle: Path) -> None:
        """Install the bundle, all or nothing.

        Raises:
            InstallError: the board is as it was.
        """
        plan = _plan(bundle)
        self._services.refuse_while_armed()
        with self._locked():
            self._recover()
            self._make_release(bundle, plan)
            self._services.refuse_while_armed()  # that took a minute
            with self._all_or_nothing():
                self._put_files(bundle)
                self._enable(plan["drones"])
                self._switch(plan["release"])
                self._restart(plan["drones"])
            self._prune()

    def rollback(self, bundle: Path) -> None:
        """Go back to the release before; the configuration stays.

        Raises:
            InstallError: there is none, or it does not start; the board is as it was.
        """
        plan = _plan(bundle)
        self._services.refuse_while_armed()
        with self._locked():
            self._recover()
            previous = link_target(self.home / "previous")
            if previous is None:
                raise InstallError("there is no release before this one")
            with self._all_or_nothing():
                self._switch(previous)
                self._restart(plan["drones"])

    def _recover(self) -> None:
        """Put back what a deployment before this one left half done."""
        if (self.root / JOURNAL).exists() and self.report.add("recover", "was cut short"):
            self._changes.undo()

    def _make_release(self, bundle: Path, plan: Plan) -> None:
        """Make a virtual environment at its final path, and let it check all configurations."""
        release = self.home / "releases" / plan["release"]
        complete = release / ".complete"
        if self.report.add("release", plan["release"], not complete.exists()):
            shutil.rmtree(release, ignore_errors=True)
            try:
                lock = bundle / "locks" / plan["lock"]
                current = self.home / "current"
                make_release(release, bundle, lock, current, self.report, self._user)
                self._check_bundle(release, bundle)
            except BaseException:
                shutil.rmtree(release, ignore_errors=True)
                raise
            os.sync()  # thousands of files; from here on the release is believed
            complete.touch()
        elif complete.exists():
            self._check_bundle(release, bundle)

    def _check_bundle(self, release: Path, bundle: Path) -> None:
        """Check the drones that come, and those installed already: they share the release."""
        folders = sorted((bundle / "config").iterdir())
        coming = {f.name for f in folders}
        others = [f for f in self._installed() if f.name not in coming]
        self._check(release, [*folders, *others])

    def _check(self, release: Path, folders: list[Path]) -> None:
        """Let a release check the configurations that it is to run.

        Raises:
            InstallError: it refuses one, or two drones claim the same thing.
        """
        try:
            check_configurations(release, [f / f"{f.name}.yaml" for f in folders], self._user)
        except InstallError as error:
            for folder in self._installed():
                if str(folder) in str(error):
                    raise InstallError(f"{error}; {_how_to_remove(folder)}") from None
            raise

    def _installed(self) -> list[Path]:
        """Return the folder of each drone on the board."""
        folders = sorted((self.root / CONFIG).glob("*"))
        return [f for f in folders if (f / f"{f.name}.yaml").exists()]

    def _put_files(self, bundle: Path) -> None:
        """Write units, rule and launchers, which are ours, and configuration, unless edited."""
        self._put_recovery(bundle / "owned")
        for source in sorted(p for p in (bundle / "owned").rglob("*") if p.is_file()):
            relative = source.relative_to(bundle / "owned")
            if str(relative) in RECOVERY:
                continue
            path, data = self.root / relative, source.read_bytes()
            differs = not path.exists() or path.read_bytes() != data
            if self.report.add("file", f"/{relative}", differs):
                self._changes.write(path, data, 0o755 if os.access(source, os.X_OK) else 0o644)
        known = self._known()
        for source in sorted(p for p in (bundle / "config").rglob("*") if p.is_file()):
            self._put_config(source, source.relative_to(bundle / "config"), known)
        if not self.report.dry_run:
            self._changes.write(self.home / "config.json", json.dumps(known, indent=1).encode())
        signers = bundle / "signers"
        absent = signers.exists() and not (self.root / SIGNERS).exists()
        if absent and self.report.add("signers", f"/{SIGNERS}: it takes their releases alone"):
            self._changes.write(self.root / SIGNERS, signers.read_bytes())

    def _put_recovery(self, owned: Path) -> None:
        """Write what puts a deployment back that is cut short, and let it start with the board."""
        for relative in RECOVERY:
            path, data = self.root / relative, (owned / relative).read_bytes()
            differs = not path.exists() or path.read_bytes() != data
            if self.report.add("file", f"/{relative}", differs):
                path.parent.mkdir(parents=True, exist_ok=True)
                journal.write(path, data)
        start, target = self.root / RECOVERY_LINK, "../swarm-recover.service"
        if self.report.add("enable", start.name, link_target(start, whole=True) != target):
            start.parent.mkdir(parents=True, exist_ok=True)
            journal.link(start, target)

    def _put_config(self, source: Path, relative: Path, known: dict[str, str]) -> None:
        """Replace a file as it was deployed; lay the new one beside a file that was edited."""
        path, data = self.root / CONFIG / relative, source.read_bytes()
        there = path.read_bytes() if path.exists() else None
        edited = there is not None and known.get(str(relative)) != sha256(there)
        if there == data or there is None or not edited:
            if self.report.add("config", f"/{CONFIG}/{relative}", there != data):
                self._changes.write(path, data)
            known[str(relative)] = sha256(data)
            return
        beside = path.with_name(path.name + ".new")
        self.report.note(
            "config",
            f"/{CONFIG}/{relative} was edited here and is kept; the new one is {beside.name}",
        )
        if not self.report.dry_run:
            self._changes.write(beside, data)

    def _enable(self, drones: list[dict[str, Any]]) -> None:
        """Let swarm.target start with the board, and each drone with the target."""
        links = {"etc/systemd/system/multi-user.target.wants/swarm.target": "../swarm.target"}
        for drone in drones:
            for template in drone["units"]:
                links[f"{WANTS}/{_unit(template, drone['name'])}"] = f"../{template}"
        for name, target in links.items():
            path = self.root / name
            if self.report.add("enable", path.name, link_target(path, whole=True) != target):
                self._changes.link(path, target)

    def _switch(self, release: str) -> None:
        """Make the release the one that every drone of the board starts with."""
        before = link_target(self.home / "current")
        self._switched = self.report.add("current", release, before != release)
        if self.report.changed and not self.report.dry_run:  # with the files edited here
            self._check(self.home / "releases" / release, self._installed())
        if self._switched:
            if before is not None:
                self._changes.link(self.home / "previous", f"releases/{before}")
            self._changes.link(self.home / "current", f"releases/{release}")

    def _restart(self, drones: list[dict[str, Any]]) -> None:
        """Restart the daemons with the new release; one that does not stay up undoes it all.

        Raises:
            InstallError: a daemon failed.
        """
        if not self._services.present:
            self.report.note("start", "no systemd runs there: starts with the board")
            return
        if not self.report.changed or self.report.dry_run:
            return
        self._services.reload()
        for drone in drones:
            for template in drone["units"]:
                self._services.restart(_unit(template, drone["name"]))
        if self._switched:
            deployed = {d["name"] for d in drones}
            others = [f.name for f in self._installed() if f.name not in deployed]
            for unit in self._services.running(others):
                self._services.restart(unit)

    def _prune(self) -> None:
        """Keep the release in use and the one before."""
        keep = {link_target(self.home / "current"), link_target(self.home / "previous")}
        for release in sorted((self.home / "releases").glob("*")):
            if release.name not in keep and self.report.add("remove", release.name):
                shutil.rmtree(release, ignore_errors=True)

    def _known(self) -> dict[str, str]:
        """Return the hash of every configuration file as it was deployed."""
        file = self.home / "config.json"
        return dict(json.loads(file.read_text())) if file.exists() else {}

    @contextlib.contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """Put everything back where an error ends what is done meanwhile."""
        try:
            yield
        except BaseException:
            self._changes.undo()
            self._services.restart_anew()
            raise
        self._changes.keep()

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Let one installation run at a time."""
        if self.report.dry_run:
            yield
            return
        self.home.mkdir(parents=True, exist_ok=True)
        with (self.root / LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InstallError("another deployment is under way there") from None
            yield


def _plan(bundle: Path) -> Plan:
    plan: Plan = json.loads((bundle / "plan.json").read_text())
    return plan


def _unit(template: str, drone: str) -> str:
    return template.replace("@", f"@{drone}")


def _how_to_remove(folder: Path) -> str:
    name = folder.name
    return (
        f"if {name} is no drone of this board any more: `sudo systemctl disable --now "
        f"companion@{name} mavlink-bridge@{name}; sudo rm -r {folder}`"
    )


def main(arguments: list[str] | None = None) -> int:
    """Install or roll back, and print the report; 1 where nothing was changed by an error."""
    parser = argparse.ArgumentParser(description="Installs a bundle of swarm-companion.")
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--root", type=Path, default=Path("/"))
    parser.add_argument("--dry-run", action="store_true")
    parser.add_argument("--rollback", action="store_true")
    options = parser.parse_args(arguments)
    os.umask(0o022)  # the daemon is not the user who installs it
    started = time.monotonic()
    report = Report(options.dry_run)
    live = options.root == Path("/") and Path("/run/systemd/system").is_dir()
    error = None
    try:
        if sys.version_info < (3, 11):  # noqa: UP036  (the board's Python, not this one)
            raise InstallError(f"python3 is {sys.version.split()[0]}, 3.11 is needed")
        user = installing_user(options.root, options.bundle, options.dry_run)
        board = Board(options.root, report, ["systemctl"] if live else None, user)
        (board.rollback if options.rollback else board.install)(options.bundle)
    except (InstallError, OSError, ValueError) as problem:
        error = str(problem)
    print(
        json.dumps(
            {
                "ok": error is None,
                "error": error,
                "changed": report.changed and error is None,
                "seconds": round(time.monotonic() - started, 1),
                "steps": report.steps,
            }
        )
    )
    return 0 if error is None else 1


if __name__ == "__main__":
    sys.exit(main())
