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

from companion.board.installer import SIGNERS
from companion.board.release_file import IDENTITY, NAMESPACE, SIGNATURE, SUMS, plain

Outcome = dict[str, Any]
# Refuses, before any of it runs, a release that is not as it was made or, where the board was told
# whose releases it takes, not signed by them.
_CHECK = f"""
refuse() {{{{ echo "$1" >&2; exit 1; }}}}
(cd "$d" && sha256sum --quiet -c {SUMS} >&2) || refuse "the release is not as it was made"
signers={{root}}/{SIGNERS}
if [ -e "$signers" ]; then
    [ -e "$d/{SIGNATURE}" ] || refuse "the release is not signed, and $signers asks for it"
    ssh-keygen -Y verify -f "$signers" -I {IDENTITY} -n {NAMESPACE} -s "$d/{SIGNATURE}" \\
        < "$d/{SUMS}" > /dev/null 2>&1 || refuse "the release is not signed by a key of $signers"
fi
"""
# Unpacks the bundle, checks and installs it, cleans up, and ends with the installer's exit status.
_REMOTE = """
set -e
d=$(mktemp -d)
trap 'rm -rf "$d"' EXIT
tar -xf - -C "$d"
{check}if [ "$(id -u)" = 0 ]; then s=; else s='sudo -n'; fi
$s python3 "$d" "$d" {arguments}
"""


def install_here(bundle: Path, arguments: Sequence[str]) -> Outcome:
    """Run the installer on this machine."""
    script = f'd=$1; shift\n{_check(arguments)}exec "$@"'
    install = [sys.executable, str(bundle), str(bundle), *arguments]
    command = ["sh", "-c", script, "sh", str(bundle), *install]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    return _outcome(done.stdout, done.stderr)


def _check(arguments: Sequence[str]) -> str:
    """Return the shell commands that check the release in $d for the board below --root."""
    root = arguments[arguments.index("--root") + 1].rstrip("/")
    return _CHECK.format(root=shlex.quote(root) if root else "")


def install_over_ssh(
    bundle: Path, arguments: Sequence[str], host: str, shell: Sequence[str]
) -> Outcome:
    """Run the installer on `host`; shell: the ssh command with its options."""
    script = _REMOTE.format(arguments=shlex.join(arguments), check=_check(arguments))
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
            archive.add(bundle, arcname=".", filter=plain)
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
