"""Installs the example package as pip does: its module and its entry points in one folder."""

import shutil
import tomllib
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "examples" / "own-parts"


def install(folder: Path) -> Path:
    """Install into `folder`, without a build backend and a network; return the folder."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text("utf-8"))["project"]
    info = folder / "own_parts-0.1.dist-info"
    info.mkdir(parents=True)
    shutil.copy(EXAMPLE / "own_parts.py", folder)
    about = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(about, "utf-8")
    lines = []
    for group, named in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in named.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", "utf-8")
    return folder
