"""The account without rights that installs a release: root runs nothing that a package brings.

Like `installer.py` it runs on the board, and needs only Python itself.
"""

from __future__ import annotations

import os
import pwd
from pathlib import Path

from .changes import User, run

NAME = "swarm-install"


def installing_user(root: Path, bundle: Path, dry_run: bool) -> User | None:
    """Return the account that runs pip and the releases' checks; None: this process's user.

    On a board (`root` is /) that is an account of its own, made where it is missing. An image is
    made by whoever makes it. dry_run: make no account.

    Raises:
        InstallError: the account cannot be made.
    """
    if root != Path("/") or os.geteuid() != 0:
        return None
    try:
        found = pwd.getpwnam(NAME)
    except KeyError:
        if dry_run:
            return None
        home = ["--home-dir", "/nonexistent", "--no-create-home"]
        run(["useradd", "--system", *home, "--shell", "/usr/sbin/nologin", NAME])
        found = pwd.getpwnam(NAME)
    bundle.chmod(0o755)  # it holds no secret, and the account must read it
    return User(found.pw_uid, found.pw_gid)
