"""Pulls the flight logs of a drone: from its board over ssh, or from folders of this machine.

The logs belong to the service's dynamic user, below a folder that only root may enter. So the board
is asked for a tar stream, of those logs alone that are not here yet.
"""

from __future__ import annotations

import io
import shlex
import shutil
import subprocess
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from companion.settings.config import CompanionConfig
from mavlink_bridge.shared.archives import extract

SERVICE_LOGS = "/var/log/swarm-companion"  # LogsDirectory of the systemd unit
_SUFFIXES = (".mcap", ".tlog")
_TIMEOUT = 600.0  # s
# Lists the logs with their sizes; then sends those named on stdin as a tar stream.
_LIST = "cd {folder} && find . -maxdepth 1 -name '*.mcap' -printf '%s %f\\n' -o "
_LIST += "-maxdepth 1 -name '*.tlog' -printf '%s %f\\n'"
_SEND = "cd {folder} && tar -cf - -T -"


@dataclass(frozen=True)
class Pulled:
    """What came: how many files are new, the newest log of all, and why there is none."""

    count: int = 0
    newest: Path | None = None
    problem: str = ""


def pull(drone: CompanionConfig, into: Path, shell: Sequence[str] | str) -> Pulled:
    """Copy the logs of a drone that `into`/NAME does not hold yet.

    shell: the ssh command with its options, for a drone with board.host; the logs of one without
    are looked for where the service writes them here, and where its file says.
    """
    target = into / drone.name
    try:
        target.mkdir(parents=True, exist_ok=True)
        if drone.board.host:
            words = shlex.split(shell) if isinstance(shell, str) else list(shell)
            count = _over_ssh(drone, target, words)
        else:
            count = _from_here(drone, target)
    except (OSError, subprocess.SubprocessError, tarfile.TarError) as error:
        return Pulled(problem=f"{drone.name}: logs: {error}")
    logs = sorted(target.glob("*.mcap"), key=lambda p: p.stat().st_mtime)
    if not logs:
        return Pulled(count, None, f"{drone.name}: no flight log")
    return Pulled(count, logs[-1])


def _over_ssh(drone: CompanionConfig, target: Path, shell: list[str]) -> int:
    folder = shlex.quote(f"{SERVICE_LOGS}/{drone.name}")
    listed = _ask(shell, drone.board.host or "", _LIST.format(folder=folder), b"")
    wanted = []
    for line in listed.decode(errors="replace").splitlines():
        size, _, name = line.partition(" ")
        if size.isdigit() and Path(name).name == name and Path(name).suffix in _SUFFIXES:
            here = target / name
            if not (here.exists() and here.stat().st_size == int(size)):
                wanted.append(name)
    if not wanted:
        return 0
    names = "".join(f"{n}\n" for n in wanted).encode()
    data = _ask(shell, drone.board.host or "", _SEND.format(folder=folder), names)
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        members = [m for m in archive.getmembers() if m.isfile() and m.name in wanted]
        extract(archive, members, target)
    return len(members)


def _ask(shell: list[str], host: str, script: str, stdin: bytes) -> bytes:
    """Run a script as root on the board and return what it says.

    Raises:
        OSError: it fails; the message is its last line.
    """
    as_root = (
        f'if [ "$(id -u)" = 0 ]; then s=; else s="sudo -n"; fi; $s sh -c {shlex.quote(script)}'
    )
    done = subprocess.run(
        [*shell, host, "sh", "-c", shlex.quote(as_root)],
        input=stdin,
        capture_output=True,
        timeout=_TIMEOUT,
    )
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no answer"]
        raise OSError(f"{host}: {said[0]}")
    return done.stdout


def _from_here(drone: CompanionConfig, target: Path) -> int:
    found = {p for p in (Path(SERVICE_LOGS) / drone.name).glob("*") if p.suffix in _SUFFIXES}
    if drone.log.path is not None:
        pattern = Path(drone.log.path.replace("{time}", "*")).with_suffix("")
        found |= {p for s in _SUFFIXES for p in pattern.parent.glob(f"{pattern.name}{s}")}
    count = 0
    for log in sorted(found):
        here = target / log.name
        if here.exists() and here.stat().st_size == log.stat().st_size:
            continue
        shutil.copy2(log, here)
        count += 1
    return count
