"""Runs the installer of a bundle: here below a root, or on a board over ssh.

One ssh connection carries the bundle in, as a tar stream, and the report out. The board needs sshd,
tar and python3; a user other than root needs sudo without a password.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tarfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

Outcome = dict[str, Any]
# Unpacks the bundle, installs it, cleans up, and ends with the installer's exit status.
_REMOTE = """
set -e
d=$(mktemp -d)
trap 'rm -rf "$d"' EXIT
tar -xf - -C "$d"
if [ "$(id -u)" = 0 ]; then s=; else s='sudo -n'; fi
$s python3 "$d" "$d" {arguments}
"""


def install_here(bundle: Path, arguments: Sequence[str]) -> Outcome:
    """Run the installer on this machine."""
    command = [sys.executable, str(bundle), str(bundle), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    return _outcome(done.stdout, done.stderr)


def install_over_ssh(
    bundle: Path, arguments: Sequence[str], host: str, shell: Sequence[str]
) -> Outcome:
    """Run the installer on `host`; shell: the ssh command with its options."""
    script = _REMOTE.format(arguments=shlex.join(arguments))
    try:
        process = subprocess.Popen(
            [*shell, host, "sh", "-c", shlex.quote(script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
    except OSError as error:
        return _outcome("", f"{shell[0]}: {error.strerror}")
    assert process.stdin is not None
    feeder = threading.Thread(target=_feed, args=(bundle, process.stdin))
    stdin, process.stdin = process.stdin, None  # communicate() must leave it to the feeder
    feeder.start()
    out, err = process.communicate()
    feeder.join()
    stdin.close()
    # A board may answer in Latin-1; that must not lose the rows of the other boards.
    return _outcome(out.decode(errors="replace"), err.decode(errors="replace"))


def _feed(bundle: Path, stream: IO[bytes]) -> None:
    """Write the bundle as a tar stream; a board that hangs up early says why on stderr."""
    try:
        with tarfile.open(fileobj=stream, mode="w|") as archive:
            archive.add(bundle, arcname=".")
        stream.close()
    except OSError:
        return


def _outcome(out: str, err: str) -> Outcome:
    """Return the installer's report, or the error that kept it from reporting."""
    lines = out.strip().splitlines()
    try:
        report: Outcome = json.loads(lines[-1])
        return report
    except (IndexError, ValueError):
        said = " | ".join(err.strip().splitlines()[-3:]) or "no answer"
        return {"ok": False, "error": said, "changed": False, "seconds": 0.0, "steps": []}
