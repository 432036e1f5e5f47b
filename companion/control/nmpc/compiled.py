"""The compiled path: the kernel in C and CasADi's generated stage functions as one shared library.

Used where a C compiler is at hand, kept in the user's cache by the hash of its source, and
never required: every failure gives None, and the caller goes on with CasADi's virtual machine
and PIQP. The weights are arguments, so drones that differ only in weights share a library.
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
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.problem import Stage
from companion.control.nmpc.qp import change_bounds, input_bounds
from companion.model import NU, NX
from mavlink_bridge.shared.arrays import Vector

# No -ffast-math: the order of operations is the same on every run.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fPIC", "-shared")
MAX_ROWS, MAX_STAGES = 160, 128  # as in the kernel
COMPILE_TIME = 600  # s: three on an idle machine, but a loaded one is no reason for none
KERNEL = ("kernel_stage.c", "kernel_solve.c")
TOLERANCE = 1e-6
FIRST_COMPLEMENTARITY = 3.0


def library(stage: Stage, config: NmpcConfig) -> ctypes.CDLL | None:
    """The library for these stage functions: cached, freshly compiled, or None."""
    compiler = shutil.which(os.environ.get("CC", "")) or shutil.which("gcc") or shutil.which("cc")
    if compiler is None or config.N > MAX_STAGES or len(stage.margin.rows) > MAX_ROWS:
        return None
    try:
        source = _source(stage)
        key = "\n".join([source, *FLAGS, compiler, _processor()])
        path = _cache() / f"nmpc-{hashlib.sha256(key.encode()).hexdigest()[:20]}.so"
        with _alone(path.parent):
            if path.exists():
                with contextlib.suppress(OSError):  # cut short by a full disk: made anew
                    return ctypes.CDLL(str(path))
            _compile(compiler, source, path)
            return ctypes.CDLL(str(path))
    except (OSError, RuntimeError, subprocess.SubprocessError):  # Runtime: nobody's home is known
        return None


def _source(stage: Stage) -> str:
    generator = ca.CodeGenerator("stages", {"with_header": False})
    generator.add(stage.linearise)
    generator.add(stage.evaluate)
    package = resources.files("companion.control.nmpc")
    return "\n".join([generator.dump(), *(package.joinpath(k).read_text() for k in KERNEL)])


def _processor() -> str:
    """What the machine can do: a cache may be carried to, or shared with, another one."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    abilities = {line for line in lines if line.startswith(("flags", "Features", "model name"))}
    return "\n".join([platform.machine(), platform.processor(), *sorted(abilities)])


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "swarm-companion"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """One process at a time: nine daemons that start together compile once, not nine times."""
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
        command = [compiler, *FLAGS, "-o", str(built), str(code), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=COMPILE_TIME)
        built.replace(path)


def _addresses(arrays: list[Vector]) -> Any:
    return (ctypes.c_void_p * len(arrays))(*[a.ctypes.data for a in arrays])


class Sweep:
    """A stage function over all stages; `strides` in numbers, 0 for what all stages share."""

    def __init__(
        self,
        library: ctypes.CDLL,
        function: ca.Function,
        N: int,
        inputs: list[tuple[Vector, int]],
        outputs: list[tuple[Vector, int]],
    ) -> None:
        arrays = [array for array, _ in [*inputs, *outputs]]
        strides = np.array([stride for _, stride in [*inputs, *outputs]], dtype=np.int32)
        iw = np.zeros(max(1, function.sz_iw()), dtype=np.int64)
        w = np.zeros(max(1, function.sz_w()))
        self._keep = (arrays, strides, iw, w)
        self._call = library.sweep
        self._arguments = (
            ctypes.c_int(function.name() == "evaluate"),
            ctypes.c_int(N),
            ctypes.c_int(len(inputs)),
            ctypes.c_int(len(outputs)),
            _addresses(arrays),
            ctypes.c_void_p(strides.ctypes.data),
            ctypes.c_void_p(iw.ctypes.data),
            ctypes.c_void_p(w.ctypes.data),
        )

    def __call__(self) -> None:
        """Evaluate."""
        self._call(*self._arguments)


class CompiledProgram:
    """The quadratic program of `qp.py`, solved by the kernel in C."""

    def __init__(self, config: NmpcConfig, stage: Stage, library: ctypes.CDLL) -> None:
        self.source = np.zeros(config.N * stage.size)
        self.u_min, self.u_max = input_bounds(config)
        numbers = [
            *self.u_min,
            *self.u_max,
            *change_bounds(config),
            config.penalty,
            config.penalty_quadratic,
            TOLERANCE,
            FIRST_COMPLEMENTARITY,
        ]
        shape = [
            config.N,
            stage.size,
            len(stage.margin.rows),
            config.neighbours,
            config.M_constraint,
            stage.gap.offset,
            stage.dynamics.offset,
            len(stage.dynamics.rows),
            stage.gradient.offset,
            stage.hessian.offset,
            len(stage.hessian.rows),
            stage.margin.offset,
            stage.slope.offset,
            len(stage.slope.rows),
        ]
        pieces = (stage.dynamics, stage.hessian, stage.slope)
        index = [array for piece in pieces for array in (piece.rows, piece.columns)]
        library.stage_bytes.restype = ctypes.c_size_t
        work = np.zeros(config.N * library.stage_bytes() // 8 + 1)
        self._u, self._u_last = np.zeros((config.N, NU)), np.zeros(NU)
        self._dx, self._du = np.zeros((config.N, NX)), np.zeros((config.N, NU))
        self._arrays: tuple[NDArray[Any], ...] = (
            np.array(shape, dtype=np.int32),
            np.concatenate(index).astype(np.int32),
            self.source,
            np.array(numbers),
            self._u,
            self._u_last,
            work,
            self._dx,
            self._du,
        )
        self._arguments = [ctypes.c_void_p(a.ctypes.data) for a in self._arrays]
        self._call = library.solve_program
        self.iterations = 0

    def solve(self, u: Vector, u_last: Vector) -> tuple[Vector, Vector] | None:
        """Steps (dx of x_1…x_N, du) from the linearisation in `source`; None if none is found."""
        self._u[:], self._u_last[:] = u, u_last
        self.iterations = self._call(*self._arguments)
        return (self._dx, self._du) if self.iterations >= 0 else None
