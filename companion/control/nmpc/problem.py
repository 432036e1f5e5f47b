"""The problem of eq. (28)-(38) as CasADi functions of one stage.

Stage i spans u_i from x_i to x_{i+1}. Its terms are those of (29) in x_{i+1}, u_i and the
change from u_{i-1}. Its constraints are the dynamics (31) and the distances (37), (38) at
x_{i+1}. The real-time solver uses the linearised stage, the reference solver the stage itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from companion.control.nmpc import constraints, costs
from companion.control.nmpc.casadi_model import casadi_step
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.parameters import scene_symbols, weight_symbols
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
class Stage:
    """The two functions of a stage, and the place of each matrix in the linearised column.

    linearise: (x, before, u, x_next, stage, scene, weights) → column of `size` numbers.
    evaluate: the same arguments → (x_{i+1} by the model, cost, margins [m] of agents, cylinders,
    planes).
    """

    linearise: ca.Function
    evaluate: ca.Function
    size: int
    gap: Piece
    dynamics: Piece
    gradient: Piece
    hessian: Piece
    margin: Piece
    slope: Piece


def build_stage(config: NmpcConfig) -> Stage:
    """Return the stage functions for the sizes of `config`; this takes some 10 ms."""
    local = ca.SX.sym("local", LOCAL)
    x, before, u, after = (local[s] for s in (LOCAL_X, LOCAL_BEFORE, LOCAL_U, LOCAL_NEXT))
    weights, w = weight_symbols()
    scene_vector, stage_vector, scene = scene_symbols(config)
    arguments = [x, before, u, after, stage_vector, scene_vector, weights]

    reached = casadi_step(x, u, config.dt, scene.disturbance)
    terms = [
        *costs.state_terms(after, scene, w),
        *costs.change_terms(u, before, w),
        *costs.effort_terms(u, w),
    ]
    margins = ca.vertcat(
        constraints.agent_margins(after[:3], scene, w),
        constraints.cylinder_margins(after[:3], scene, w),
        constraints.plane_margins(after[:3], scene, w),
    )
    cost = sum((t.value() for t in terms), ca.SX(0))
    gradient, hessian = majoriser(terms, local)
    matrices = [
        reached - after,
        ca.jacobian(reached, ca.vertcat(x, u)),
        ca.densify(gradient),
        ca.triu(hessian),
        ca.densify(margins),
        ca.jacobian(margins, after[:3]),
    ]
    pieces, offset = [], 0
    for matrix in matrices:
        rows, columns = matrix.sparsity().get_triplet()
        pieces.append(Piece(offset, np.array(rows, dtype=int), np.array(columns, dtype=int)))
        offset += matrix.nnz()
    column = ca.vertcat(*[m.nz[:] for m in matrices])
    return Stage(
        ca.Function("linearise", arguments, [column], {"cse": True}),
        ca.Function("evaluate", arguments, [reached, cost, ca.densify(margins)], {"cse": True}),
        offset,
        *pieces,
    )


def majoriser(terms: list[costs.Term], variables: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the gradient of the sum of terms, and the sum of their majorising Hessians."""
    gradient, hessian = ca.SX(LOCAL, 1), ca.SX(LOCAL, LOCAL)
    for term in terms:
        gradient += ca.jacobian(term.residual, variables).T @ term.gradient()
        hessian += term.hessian(variables)
    return gradient, hessian
