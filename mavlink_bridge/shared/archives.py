"""Plain files out of a tar archive; Debian 12's Python, 3.11.2, has no filter for that."""

from __future__ import annotations

import os
import shutil
import tarfile
from collections.abc import Iterable
from pathlib import Path


def extract(archive: tarfile.TarFile, members: Iterable[tarfile.TarInfo], folder: Path) -> None:
    """Write members of an archive below `folder`, with their times, as anybody may read them.

    Raises:
        TarError: a link, a folder, a device, or a name that leads elsewhere.
    """
    for member in members:
        path = folder / member.name
        content = archive.extractfile(member) if member.isreg() else None
        if content is None or not path.resolve().is_relative_to(folder.resolve()):
            raise tarfile.TarError(f"{member.name} is no plain file")
        path.parent.mkdir(parents=True, exist_ok=True)
        with content, path.open("wb") as file:
            shutil.copyfileobj(content, file)
        path.chmod(0o755 if member.mode & 0o100 else 0o644)
        os.utime(path, (member.mtime, member.mtime))
