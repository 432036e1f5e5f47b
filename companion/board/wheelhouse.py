"""A wheelhouse: the wheels that the lock files name, for boards without internet."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from companion.board.release_file import BundleError

LOCKS = Path(__file__).with_name("locks")
_GLIBC = range(17, 37)  # manylinux tags up to that of Debian 12


def fetch(folder: Path, architecture: str, python: str) -> int:
    """Fetch the wheels of a board's architecture and Python; return how many there are.

    Each is compared with the hash in the lock file, as it is again on the board.

    Raises:
        BundleError: a version of Python that is none, or pip failed.
    """
    if not re.fullmatch(r"3\.\d\d", python):
        raise BundleError(f"--python {python}: must be a version as 3.11")
    tags = ["manylinux2014", *(f"manylinux_2_{minor}" for minor in _GLIBC)]
    platforms = [word for tag in tags for word in ("--platform", f"{tag}_{architecture}")]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    command += ["--only-binary", ":all:", "--no-deps", "--require-hashes"]
    command += ["--python-version", python, *platforms, "--dest", str(folder)]
    done = subprocess.run(
        [*command, "--requirement", str(LOCKS / "eyes.txt")], capture_output=True, text=True
    )
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()[-2:]
        raise BundleError(f"--make-wheelhouse: {' | '.join(said)}")
    return len(list(folder.glob("*.whl")))
