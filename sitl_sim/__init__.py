"""The simulated world, and vehicles that speak MAVLink."""

from pathlib import Path


def drop_stale_kernels(package: Path) -> None:
    """Remove Numba's compiled kernels of a package if one of its sources is newer than any of them.

    Numba's cache looks at a kernel's own file, not at the functions and constants that it takes
    from others: after an update the old machine code would fly on.
    """
    try:
        compiled = [*package.glob("**/__pycache__/*.nb[ic]")]
        newest = max((p.stat().st_mtime for p in package.glob("**/*.py")), default=0.0)
        if any(p.stat().st_mtime < newest for p in compiled):
            for p in compiled:
                p.unlink(missing_ok=True)
    except OSError:
        pass  # another process is at it, or nobody may write here and so nothing was edited


drop_stale_kernels(Path(__file__).parent)
