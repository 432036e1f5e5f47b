"""The layout of a stage of `problem.py`: its variables, and where its matrices are.

It is all that a solver with a compiled kernel needs to know of the problem; CasADi, which makes the
functions, is then not loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.model import NU, NX

Indices = NDArray[np.int64]

# Local variables of a stage, in this order: x_i, u_{i-1}, u_i, x_{i+1}.
LOCAL = 2 * (NX + NU)
LOCAL_X = slice(0, NX)
LOCAL_BEFORE = slice(NX, NX + NU)
LOCAL_U = slice(NX + NU, NX + 2 * NU)
LOCAL_NEXT = slice(NX + 2 * NU, LOCAL)


@dataclass(frozen=True)
class Piece:
    """A sparse matrix inside a stage's column of numbers: entry n is at offset + n."""

    offset: int
    rows: Indices
    columns: Indices


@dataclass(frozen=True)
class StageLayout:
    """The place of each matrix in the linearised column, and the functions' memory.

    size: numbers in the column. work: by function, how many integers and numbers it works on.
    """

    size: int
    gap: Piece
    dynamics: Piece
    gradient: Piece
    hessian: Piece
    margin: Piece
    slope: Piece
    work: Mapping[str, tuple[int, int]]
