"""The compiled path: the kernel in C and CasADi's generated stage functions as one shared library.

A wheel brings it compiled for the default sizes of the problem (`prebuilt.py`). Else it is used
where there is a C compiler, and kept in the user's cache by the hash of its source. It is never
required: every failure gives None, and the solver goes on with CasADi's virtual machine. The
quadratic program is then solved by the wheel's kernel, which knows any sizes, or by PIQP, where
that is installed (extra `piqp`). The weights are arguments, so drones that differ only in weights
share a library.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

from companion.control.nmpc import prebuilt
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.generated import Generated, cache_folder
from companion.control.nmpc.kernel import MAX_ROWS, MAX_STAGES, PROGRAM_FILES, SWEEP_FILE
from companion.control.nmpc.layout import StageLayout

_OPTIONS = ("-march=native",)
_COMPILE_TIME = 600  # s: an idle machine takes three, a loaded one many times that


def library(made: Generated, config: NmpcConfig) -> ctypes.CDLL | None:
    """Return the library of these stage functions: the wheel's, cached, fresh, or None."""
    if not _fits(made.layout, config):
        return None
    code = source(made.code)
    found = prebuilt.load(code)
    return found if found is not None else _compiled_here(code)


def program_library(stage: StageLayout, config: NmpcConfig) -> ctypes.CDLL | None:
    """Return the wheel's library that solves the quadratic program alone, or None."""
    return prebuilt.load(program_source()) if _fits(stage, config) else None


def _fits(stage: StageLayout, config: NmpcConfig) -> bool:
    """Return whether the kernel's memory is large enough for these sizes."""
    return config.N <= MAX_STAGES and len(stage.margin.rows) <= MAX_ROWS


def _compiled_here(code: str) -> ctypes.CDLL | None:
    """Return the library that this machine's compiler makes, from the cache where it is there."""
    compiler = shutil.which(os.environ.get("CC", "")) or shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    try:
        key = "\n".join([code, *prebuilt.FLAGS, *_OPTIONS, compiler, _processor()])
        path = cache_folder() / f"nmpc-{hashlib.sha256(key.encode()).hexdigest()[:20]}.so"
        with _lock(path.parent):
            if path.exists():
                with contextlib.suppress(OSError):  # cut short by a full disk: compiled again
                    return ctypes.CDLL(str(path))
            _compile(compiler, code, path)
            return ctypes.CDLL(str(path))
    except (OSError, RuntimeError, subprocess.SubprocessError):  # Runtime: the user has no home
        return None


def source(stages: str) -> str:
    """Return the whole source: CasADi's stage functions, the sweeps over them, the program."""
    return "\n".join([stages, _text(SWEEP_FILE), program_source()])


def program_source() -> str:
    """Return the source of the quadratic program, which depends on no size of the problem."""
    return "\n".join(_text(name) for name in PROGRAM_FILES)


def _text(name: str) -> str:
    """Return the text of a file of the kernel."""
    return resources.files("companion.control.nmpc").joinpath(name).read_text()


def compile_kernel(compiler: str, options: tuple[str, ...], source: Path, built: Path) -> None:
    """Compile a kernel.

    Raises:
        OSError, SubprocessError: there is no such compiler, or it fails.
    """
    command = [compiler, *prebuilt.FLAGS, *options, "-o", str(built), str(source), "-lm"]
    subprocess.run(command, check=True, capture_output=True, timeout=_COMPILE_TIME)


def _processor() -> str:
    """Return what the processor can do: a cache may be carried to another machine."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    abilities = {line for line in lines if line.startswith(("flags", "Features", "model name"))}
    return "\n".join([platform.machine(), platform.processor(), *sorted(abilities)])


@contextlib.contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Hold the folder's lock: nine daemons that start together compile once, not nine times."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _compile(compiler: str, source: str, path: Path) -> None:
    """Compile beside `path` and move into place, so that no other process sees half a file."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        code, built = Path(folder) / "nmpc.c", Path(folder) / "nmpc.so"
        code.write_text(source)
        compile_kernel(compiler, _OPTIONS, code, built)
        built.replace(path)
