"""The simulated world, and vehicles that communicate by MAVLink.

For notebooks and scripts: `from sitl_sim import fly, load, campaign` (`sitl_sim.api`).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sitl_sim.api import CampaignResult, FlightResult, campaign, fly, load, load_flight

__all__ = ["CampaignResult", "FlightResult", "campaign", "fly", "load", "load_flight"]


def __getattr__(name: str) -> Any:
    """Import the public functions where they are first asked for: the package stays light."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from sitl_sim import api

    return getattr(api, name)


def drop_stale_kernels(package: Path, *others: Path) -> None:
    """Remove Numba's compiled kernels of a package where a source is newer than any of them.

    others: sources outside the package whose constants the kernels use. Numba's cache checks a
    kernel's own file, not the functions and constants that it takes from other files: after an
    update the old machine code would fly on.
    """
    try:
        compiled = [*package.glob("**/__pycache__/*.nb[ic]")]
        sources = [*package.glob("**/*.py"), *others]
        newest = max((p.stat().st_mtime for p in sources), default=0.0)
        if any(p.stat().st_mtime < newest for p in compiled):
            for p in compiled:
                p.unlink(missing_ok=True)
    except OSError:
        pass  # another process removes them, or the folder is read-only: nothing was edited


_HERE = Path(__file__).parent
drop_stale_kernels(_HERE, _HERE.parent / "mavlink_bridge" / "shared" / "thrust.py")
