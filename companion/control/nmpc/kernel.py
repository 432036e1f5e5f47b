"""The kernel in C as Python calls it: its structures, its sizes, and the calls.

Each structure is that of `kernel_stage.c` or `kernel_sweep.c` of the same name, field by field; a
test holds them together.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int, c_longlong, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.layout import (
    LOCAL_BEFORE,
    LOCAL_NEXT,
    LOCAL_U,
    Piece,
    StageLayout,
)
from companion.control.nmpc.qp import change_bounds, input_bounds
from companion.model import NU, NX
from mavlink_bridge.shared.arrays import Vector

PROGRAM_FILES = ("kernel_stage.c", "kernel_solve.c")
SWEEP_FILE = "kernel_sweep.c"
MAX_ROWS, MAX_STAGES, MAX_ARGUMENTS = 160, 128, 64
# What the kernel's files are compiled with.
SIZES = {
    "NX": NX,
    "NU": NU,
    "LOCAL_BEFORE": LOCAL_BEFORE.start,
    "LOCAL_U": LOCAL_U.start,
    "LOCAL_NEXT": LOCAL_NEXT.start,
    "MAX_ROWS": MAX_ROWS,
    "MAX_STAGES": MAX_STAGES,
    "MAX_ARGUMENTS": MAX_ARGUMENTS,
}
TOLERANCE = 1e-5
# At the first point; a step that follows another begins near the last one's solution.
FIRST_COMPLEMENTARITY, NEXT_COMPLEMENTARITY = 3.0, 0.01

_Inputs = c_double * NU


class PieceStructure(ctypes.Structure):
    """A `Piece` of `layout.py`, and how many entries it has."""

    _fields_ = (
        ("offset", c_int),
        ("count", c_int),
        ("rows", POINTER(c_int)),
        ("columns", POINTER(c_int)),
    )


class ProgramStructure(ctypes.Structure):
    """The quadratic program of `qp.py`: sizes, where its matrices are, bounds, and memory."""

    _fields_ = (
        ("N", c_int),
        ("column", c_int),
        ("rows", c_int),
        ("agents", c_int),
        ("agent_stages", c_int),
        ("gap", PieceStructure),
        ("dynamics", PieceStructure),
        ("gradient", PieceStructure),
        ("hessian", PieceStructure),
        ("margin", PieceStructure),
        ("slope", PieceStructure),
        ("low", _Inputs),
        ("high", _Inputs),
        ("change", _Inputs),
        ("dt", c_double),
        ("penalty", c_double),
        ("quadratic", c_double),
        ("tolerance", c_double),
        ("complementarity", c_double),
        ("again", c_int),
        ("source", POINTER(c_double)),
        ("u", POINTER(c_double)),
        ("u_last", POINTER(c_double)),
        ("work", c_void_p),
        ("dx", POINTER(c_double)),
        ("du", POINTER(c_double)),
    )


class SweepStructure(ctypes.Structure):
    """A stage function over all stages: its arrays, and their strides in numbers."""

    _fields_ = (
        ("N", c_int),
        ("inputs", c_int),
        ("outputs", c_int),
        ("base", POINTER(POINTER(c_double))),
        ("stride", POINTER(c_int)),
        ("iw", POINTER(c_longlong)),
        ("w", POINTER(c_double)),
    )


class Sweep:
    """A stage function over all stages, called on arrays that stay in place."""

    def __init__(
        self,
        library: ctypes.CDLL,
        name: str,
        work: tuple[int, int],
        N: int,
        inputs: list[tuple[Vector, int]],
        outputs: list[tuple[Vector, int]],
    ) -> None:
        """Each array comes with its stride from stage to stage; 0: all stages share it.

        work: integers and numbers that the function works on.
        """
        arrays = [array for array, _ in [*inputs, *outputs]]
        strides = np.array([stride for _, stride in [*inputs, *outputs]], dtype=np.int32)
        iw = np.zeros(max(1, work[0]), dtype=np.int64)
        w = np.zeros(max(1, work[1]))
        base = (POINTER(c_double) * len(arrays))(*[_doubles(a) for a in arrays])
        self._arrays = (arrays, strides, iw, w, base)
        self._structure = SweepStructure(
            N=N,
            inputs=len(inputs),
            outputs=len(outputs),
            base=base,
            stride=_integers(strides),
            iw=iw.ctypes.data_as(POINTER(c_longlong)),
            w=_doubles(w),
        )
        self._call = library[f"sweep_{name}"]
        self._argument = ctypes.byref(self._structure)

    def __call__(self) -> None:
        """Evaluate the function at all stages."""
        self._call(self._argument)


class CompiledProgram:
    """The quadratic program of `qp.py`, solved by the kernel."""

    def __init__(self, config: NmpcConfig, stage: StageLayout, library: ctypes.CDLL) -> None:
        N = config.N
        self.source = np.zeros(N * stage.size)
        self.u_min, self.u_max = input_bounds(config)
        self._u, self._u_last = np.zeros((N, NU)), np.zeros(NU)
        self._dx, self._du = np.zeros((N, NX)), np.zeros((N, NU))
        library.stage_bytes.restype = ctypes.c_size_t
        self._work = np.zeros(N * library.stage_bytes() // 8 + 1)
        self._indices: list[NDArray[np.int32]] = []
        self._structure = ProgramStructure(
            N=N,
            column=stage.size,
            rows=len(stage.margin.rows),
            agents=config.neighbours,
            agent_stages=config.M_constraint,
            gap=self._piece(stage.gap),
            dynamics=self._piece(stage.dynamics),
            gradient=self._piece(stage.gradient),
            hessian=self._piece(stage.hessian),
            margin=self._piece(stage.margin),
            slope=self._piece(stage.slope),
            low=_Inputs(*self.u_min),
            high=_Inputs(*self.u_max),
            change=_Inputs(*change_bounds(config)),
            dt=config.dt,
            penalty=config.penalty,
            quadratic=config.penalty_quadratic,
            tolerance=TOLERANCE,
            complementarity=FIRST_COMPLEMENTARITY,
            again=0,
            source=_doubles(self.source),
            u=_doubles(self._u),
            u_last=_doubles(self._u_last),
            work=self._work.ctypes.data,
            dx=_doubles(self._dx),
            du=_doubles(self._du),
        )
        self._call = library.solve_program
        self._argument = ctypes.byref(self._structure)
        self.iterations = 0

    def _piece(self, piece: Piece) -> PieceStructure:
        rows, columns = piece.rows.astype(np.int32), piece.columns.astype(np.int32)
        self._indices += [rows, columns]  # the structure holds no more than their addresses
        return PieceStructure(piece.offset, len(rows), _integers(rows), _integers(columns))

    def solve(
        self, u: Vector, u_last: Vector, *, again: bool = False
    ) -> tuple[Vector, Vector] | None:
        """Return the steps (dx of x_1…x_N, du) from the linearisation in `source`, or None.

        u (N,4): the iterate. u_last (4,): the input before, within its bounds. again: the iterate
        is the last one and its step. None: the kernel found no solution. The arrays are overwritten
        by the next call.
        """
        self._u[:], self._u_last[:] = u, u_last
        self._structure.again = again
        self._structure.complementarity = NEXT_COMPLEMENTARITY if again else FIRST_COMPLEMENTARITY
        self.iterations = self._call(self._argument)
        return (self._dx, self._du) if self.iterations >= 0 else None


def _doubles(array: Vector) -> Any:
    return array.ctypes.data_as(POINTER(c_double))


def _integers(array: NDArray[np.int32]) -> Any:
    return array.ctypes.data_as(POINTER(c_int))
