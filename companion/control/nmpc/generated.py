"""The stage functions as C, with their layout: made by CasADi once, and kept.

Loading CasADi and making the functions takes a tenth of a second and fourteen megabytes, which a
small board does not have to spare. So a wheel brings the code of the default problem (`make
kernels`), and that of others is kept in the user's cache. Its name is a hash of all that it is made
of: the sources of the problem, the sizes in the configuration, CasADi's version. The weights are
arguments of the functions.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import numpy as np

from companion.control.nmpc import prebuilt
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.layout import Piece, StageLayout

_SOURCES = (
    ("companion", "model.py"),
    *(
        ("companion.control.nmpc", name)
        for name in (
            *("problem.py", "costs.py", "constraints.py", "parameters.py", "casadi_model.py"),
            *("layout.py", "generated.py"),
        )
    ),
)
SIZES = ("dt", "neighbours", "cylinders", "planes")  # of the configuration; a test holds them
_PIECES = ("gap", "dynamics", "gradient", "hessian", "margin", "slope")


@dataclass(frozen=True)
class Generated:
    """The functions `linearise` and `evaluate` of a stage as C, and the stage's layout."""

    code: str
    layout: StageLayout


def generated(config: NmpcConfig) -> Generated:
    """Return the code for the sizes of `config`: the wheel's, from the cache, or made now."""
    name = file_name(config)
    for folder in _folders():
        # A file that is missing, cut short or not of this form is made anew.
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            return _decoded(json.loads((folder / name).read_text()))
    made = generate(config)
    with contextlib.suppress(OSError, RuntimeError):  # Runtime: the user has no home
        _write(cache_folder() / name, encoded(made))
    return made


def generate(config: NmpcConfig) -> Generated:
    """Return the code as CasADi makes it."""
    import casadi as ca

    from companion.control.nmpc.problem import build_stage

    stage = build_stage(config)
    generator = ca.CodeGenerator("stages", {"with_header": False})
    generator.add(stage.linearise)
    generator.add(stage.evaluate)
    pieces = {name: getattr(stage, name) for name in _PIECES}
    return Generated(generator.dump(), StageLayout(size=stage.size, work=stage.work, **pieces))


def file_name(config: NmpcConfig) -> str:
    """Return the name of the file with the code for the sizes of `config`."""
    sizes = [f"{name}={getattr(config, name)!r}" for name in SIZES]
    key = "\n".join([_recipe(), *sizes])
    return f"stage-{hashlib.sha256(key.encode()).hexdigest()[:20]}.json"


@cache
def _recipe() -> str:
    """Return a hash of what makes the code, beside the sizes."""
    texts = [resources.files(package).joinpath(name).read_text() for package, name in _SOURCES]
    key = "\n".join([metadata.version("casadi"), *texts])
    return hashlib.sha256(key.encode()).hexdigest()


def encoded(made: Generated) -> str:
    """Return code and layout as text."""
    layout = made.layout
    pieces = {
        name: [piece.offset, piece.rows.tolist(), piece.columns.tolist()]
        for name in _PIECES
        for piece in [getattr(layout, name)]
    }
    return json.dumps({"code": made.code, "size": layout.size, "work": layout.work, **pieces})


def _decoded(told: dict[str, Any]) -> Generated:
    """Return code and layout of a file's content.

    Raises:
        KeyError, TypeError, ValueError: it is not of this form.
    """
    pieces = {}
    for name in _PIECES:
        offset, rows, columns = told[name]
        pieces[name] = Piece(int(offset), np.array(rows, dtype=int), np.array(columns, dtype=int))
    work = {name: (int(i), int(w)) for name, (i, w) in told["work"].items()}
    layout = StageLayout(size=int(told["size"]), work=work, **pieces)
    return Generated(str(told["code"]), layout)


def _folders() -> Iterator[Path]:
    yield prebuilt.FOLDER
    with contextlib.suppress(OSError, RuntimeError):
        yield cache_folder()


def cache_folder() -> Path:
    """Return the cache folder, made if missing.

    Raises:
        OSError, RuntimeError: it cannot be made; the user has no home.
    """
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "swarm-companion"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write(path: Path, text: str) -> None:
    """Write beside `path` and move into place, so that no other process sees half a file."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        beside = Path(folder) / path.name
        beside.write_text(text)
        beside.replace(path)
