"""Installs a bundle below a root directory; runs on the board, needs only Python itself.

    python3 BUNDLE BUNDLE --root / [--dry-run] [--rollback]

Releases lie side by side, `current` is a link: an upgrade that fails changes nothing, the old
release goes on running, and the one before stays for `--rollback`. Configuration that was
edited on the board is kept. The last line printed is the report, as JSON.
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

from .changes import Changes, InstallError, Report, existing, link_target, run, sha256

HOME = "opt/swarm-companion"
CONFIG = "etc/swarm-companion"
RUN = "run/swarm-companion"
WANTS = "etc/systemd/system/swarm.target.wants"
SPACE = 1_000_000_000  # bytes that a release and its download need
START_WITHIN = 20.0  # s to see whether a restarted daemon stays up


class Board:
    """A board's file system below `root`, and its service manager where it runs.

    systemctl: the command, or None where no systemd runs there (images, tests).
    """

    def __init__(self, root: Path, report: Report, systemctl: list[str] | None) -> None:
        self.root = root
        self.home = root / HOME
        self.report = report
        self._systemctl = systemctl
        self._changes = Changes()
        self._restarted: list[str] = []
        self._switched = False

    # --- the whole -----------------------------------------------------------------------

    def install(self, bundle: Path) -> None:
        """Bring the bundle in; all or nothing.

        Raises:
            InstallError: and the board is as it was.
        """
        plan = json.loads((bundle / "plan.json").read_text())
        self.refuse_while_armed()
        with self._locked():
            self._make_release(bundle, plan)
            self.refuse_while_armed()  # that took a minute
            try:
                self._put_files(bundle)
                self._enable(plan["drones"])
                self._switch(plan["release"])
                self._restart(plan["drones"])
            except BaseException:
                self._undo()
                raise
            self._prune()

    def rollback(self, bundle: Path) -> None:
        """Go back to the release before; the configuration stays.

        Raises:
            InstallError: there is none, or it does not start.
        """
        plan = json.loads((bundle / "plan.json").read_text())
        self.refuse_while_armed()
        previous = link_target(self.home / "previous")
        if previous is None:
            raise InstallError("there is no release before this one")
        with self._locked():
            try:
                self._switch(previous)
                self._restart(plan["drones"])
            except BaseException:
                self._undo()
                raise

    def refuse_while_armed(self) -> None:
        """Never touch a board that flies.

        Raises:
            InstallError: a daemon there says that its vehicle is armed.
        """
        for name, phase in self._armed().items():
            raise InstallError(f"{name} is armed ({phase})")

    # --- its parts, in order -------------------------------------------------------------

    def _make_release(self, bundle: Path, plan: dict[str, str]) -> None:
        """A virtual environment of its own at its final path, tried before it is used."""
        release = self.home / "releases" / plan["release"]
        complete = release / ".complete"
        if self.report.add("release", plan["release"], not complete.exists()):
            shutil.rmtree(release, ignore_errors=True)
            try:
                self._make_environment(release)
                python = str(release / "bin/python")
                run([python, *_pip(bundle), "--force-reinstall", "--no-deps"])
                run([python, *_pip(bundle)])  # what it depends on and is not there yet
                self._try_bundle(release, bundle)
            except BaseException:
                shutil.rmtree(release, ignore_errors=True)
                raise
            complete.touch()
        elif complete.exists():
            self._try_bundle(release, bundle)

    def _make_environment(self, release: Path) -> None:
        """Empty, or with what the release in use has: linked, it costs neither time nor space.

        Nothing is ever written into a linked file: pip unlinks before it writes.
        """
        before = list((self.home / "current").glob("lib/python3*/site-packages"))
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        if len(before) == 1 and before[0].parent.name == version:
            run([sys.executable, "-m", "venv", "--without-pip", str(release)])
            packages = release / "lib" / version / "site-packages"
            with contextlib.suppress(OSError):  # a file system without links: made anew
                shutil.copytree(before[0], packages, copy_function=os.link, dirs_exist_ok=True)
                return
            shutil.rmtree(release)
        free = shutil.disk_usage(existing(self.home)).free
        if free < SPACE:
            raise InstallError(f"{free / 1e6:.0f} MB free, {SPACE / 1e6:.0f} MB needed")
        run([sys.executable, "-m", "venv", str(release)])

    def _try_bundle(self, release: Path, bundle: Path) -> None:
        """What comes, and the drones that are there already: they share release and board."""
        folders = sorted((bundle / "config").iterdir())
        coming = {f.name for f in folders}
        self._try(release, [*folders, *(f for f in self._installed() if f.name not in coming)])

    def _try(self, release: Path, folders: list[Path]) -> None:
        """A release must understand the configurations that it is going to run.

        Raises:
            InstallError: it does not, or two drones want the same thing.
        """
        configs = [str(folder / f"{folder.name}.yaml") for folder in folders]
        try:
            run([str(release / "bin/python"), "-I", "-m", "companion", "check", *configs])
        except InstallError as error:
            for folder in self._installed():
                if str(folder) in str(error):
                    raise InstallError(f"{error}; {_how_to_remove(folder)}") from None
            raise

    def _installed(self) -> list[Path]:
        """The folder of each drone on the board."""
        folders = sorted((self.root / CONFIG).glob("*"))
        return [f for f in folders if (f / f"{f.name}.yaml").exists()]

    def _put_files(self, bundle: Path) -> None:
        """Units, rule and launchers are ours; configuration belongs to whoever edits it."""
        for source in sorted(p for p in (bundle / "owned").rglob("*") if p.is_file()):
            relative = source.relative_to(bundle / "owned")
            path, data = self.root / relative, source.read_bytes()
            differs = not path.exists() or path.read_bytes() != data
            if self.report.add("file", f"/{relative}", differs):
                self._changes.write(path, data, 0o755 if os.access(source, os.X_OK) else 0o644)
        known = self._known()
        for source in sorted(p for p in (bundle / "config").rglob("*") if p.is_file()):
            self._put_config(source, source.relative_to(bundle / "config"), known)
        if not self.report.dry_run:
            self._changes.write(self.home / "config.json", json.dumps(known, indent=1).encode())

    def _put_config(self, source: Path, relative: Path, known: dict[str, str]) -> None:
        """Replace what was deployed before; lay the new beside what was edited since."""
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

    def _enable(self, drones: list[dict[str, str]]) -> None:
        """Start with the board: swarm.target, and each drone in it."""
        links = {"etc/systemd/system/multi-user.target.wants/swarm.target": "../swarm.target"}
        for drone in drones:
            for template in drone["units"]:
                unit = template.replace("@", f"@{drone['name']}")
                links[f"{WANTS}/{unit}"] = f"../{template}"
        for name, target in links.items():
            path = self.root / name
            if self.report.add("enable", path.name, link_target(path, whole=True) != target):
                self._changes.link(path, target)

    def _switch(self, release: str) -> None:
        """From here on a start uses the new release, of whichever drone of the board."""
        before = link_target(self.home / "current")
        self._switched = self.report.add("current", release, before != release)
        if self.report.changed and not self.report.dry_run:  # with what was edited here
            self._try(self.home / "releases" / release, self._installed())
        if self._switched:
            if before is not None:
                self._changes.link(self.home / "previous", f"releases/{before}")
            self._changes.link(self.home / "current", f"releases/{release}")

    def _restart(self, drones: list[dict[str, str]]) -> None:
        """Daemons that run take the new release; one that does not stay up undoes it all.

        Raises:
            InstallError: a daemon failed.
        """
        if self._systemctl is None:
            self.report.note("start", "no systemd runs there: starts with the board")
            return
        if not self.report.changed or self.report.dry_run:
            return
        self._ask("daemon-reload")
        self._reload_rules()
        for drone in drones:
            for template in drone["units"]:
                self._restart_unit(template.replace("@", f"@{drone['name']}"))
        if self._switched:
            for unit in self._others({d["name"] for d in drones}):
                self._restart_unit(unit)

    def _others(self, deployed: set[str]) -> list[str]:
        """Units that run for the board's other drones; who is not up takes what is there then."""
        names = [f.name for f in self._installed() if f.name not in deployed]
        units = [f"{kind}@{n}.service" for n in names for kind in ("mavlink-bridge", "companion")]
        return [unit for unit in units if _runs(self._show(unit))]

    def _restart_unit(self, unit: str) -> None:
        self.refuse_while_armed()  # the restart before this one took its time
        before = self._show(unit).get("InvocationID", "")
        self._restarted.append(unit)
        self._ask("restart", "--no-block", unit)
        self._stays_up(unit, before)
        self.report.add("restart", unit)

    def _reload_rules(self) -> None:
        """The udev rule holds for what is plugged in already, too."""
        udevadm = shutil.which("udevadm")
        if udevadm is not None and self.root == Path("/"):
            run([udevadm, "control", "--reload"])
            run([udevadm, "trigger", "--subsystem-match=tty"])

    def _stays_up(self, unit: str, before: str) -> None:
        """Judge only what was started since; the invocation `before` still says what it said.

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
            time.sleep(0.2)
        raise InstallError(f"{unit} did not start within {START_WITHIN:.0f} s")

    def _prune(self) -> None:
        """Keep the release in use and the one before."""
        keep = {link_target(self.home / "current"), link_target(self.home / "previous")}
        for release in sorted((self.home / "releases").glob("*")):
            if release.name not in keep and self.report.add("remove", release.name):
                shutil.rmtree(release, ignore_errors=True)

    # --- helpers -------------------------------------------------------------------------

    def _undo(self) -> None:
        self._changes.undo()
        if self._restarted:
            self._ask("daemon-reload")
        for unit in self._restarted:
            if unit.partition("@")[2].removesuffix(".service") in self._armed():
                self.report.note("restart", f"{unit} is armed by now and runs on as it is")
            else:
                self._ask("restart", "--no-block", unit)

    def _armed(self) -> dict[str, str]:
        """The phase of each drone whose daemon says that its vehicle is armed."""
        armed = {}
        for file in sorted((self.root / RUN).glob("*/state.json")):
            with contextlib.suppress(OSError, ValueError):
                state = json.loads(file.read_text())
                if state.get("armed") and Path(f"/proc/{state.get('pid')}").exists():
                    armed[file.parent.name] = str(state.get("phase"))
        return armed

    def _show(self, unit: str) -> dict[str, str]:
        """What the service manager says of a unit."""
        shown = self._ask("show", "-p", "ActiveState,SubState,StatusText,InvocationID", unit)
        return dict(line.split("=", 1) for line in shown.splitlines() if "=" in line)

    def _ask(self, *arguments: str) -> str:
        assert self._systemctl is not None
        return run([*self._systemctl, *arguments])

    def _known(self) -> dict[str, str]:
        """Hash of every configuration file as it was deployed."""
        file = self.home / "config.json"
        return dict(json.loads(file.read_text())) if file.exists() else {}

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """One installation at a time."""
        if self.report.dry_run:
            yield
            return
        self.home.mkdir(parents=True, exist_ok=True)
        with (self.home / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InstallError("another deployment is under way there") from None
            yield


def _failed(state: dict[str, str]) -> bool:
    return state.get("ActiveState") == "failed" or state.get("SubState") == "auto-restart"


def _runs(state: dict[str, str]) -> bool:
    return state.get("ActiveState") in ("active", "activating") and not _failed(state)


def _up(state: dict[str, str]) -> bool:
    """Ready, or started as far as can be without its autopilot or camera."""
    active, text = state.get("ActiveState"), state.get("StatusText", "")
    return active == "active" or (active == "activating" and "waiting for" in text)


def _how_to_remove(folder: Path) -> str:
    name = folder.name
    return (
        f"if {name} is no drone of this board any more: `sudo systemctl disable --now "
        f"companion@{name} mavlink-bridge@{name}; sudo rm -r {folder}`"
    )


def _pip(bundle: Path) -> list[str]:
    """Arguments that install the wheel, from the bundle's own wheels where it brings them."""
    wheels = [str(p) for p in sorted((bundle / "wheel").glob("*.whl"))]
    house = bundle / "wheelhouse"
    source = ["--no-index", "--find-links", str(house)] if house.exists() else []
    return [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-input",
        *source,
        *wheels,
    ]


def main(arguments: list[str] | None = None) -> int:
    """Do it; 0 done, 1 failed or refused and nothing changed."""
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
    board = Board(options.root, report, ["systemctl"] if live else None)
    error = None
    try:
        if sys.version_info < (3, 11):  # noqa: UP036  (the board's Python, not ours)
            raise InstallError(f"python3 is {sys.version.split()[0]}, 3.11 is needed")
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
