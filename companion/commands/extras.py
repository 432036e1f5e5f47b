"""Optional dependencies: which extra of the distribution installs a module."""

from __future__ import annotations

EXTRAS = {
    "mavsdk": "fleet",
    "tornado": "ground",
    "onnxruntime": "eyes",
    "piqp": "piqp",
    "pyrvo": "studies",
    "scipy": "piqp",
}
"""Module → the extra that installs it (pyproject.toml)."""


def missing_extra(error: ModuleNotFoundError) -> str | None:
    """Return the line to print for a failed import; None where no extra installs the module."""
    module = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(module)
    if extra is None:
        return None
    line = f"not installed: {module}; pip install 'swarm-companion[{extra}]'"
    return f"{line}, or a C compiler" if module == "piqp" else line
