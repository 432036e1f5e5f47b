"""The problem of eq. (28)-(38) as CasADi functions of one stage.

Stage i spans u_i from x_i to x_{i+1}. Its terms are those of (29) in x_{i+1}, u_i and the
change from u_{i-1}. Its constraints are the dynamics (31) and the distances (37), (38) at
x_{i+1}. The real-time solver uses the linearised stage, the reference solver the stage itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from companion.control.nmpc import constraints, costs
from companion.control.nmpc.casadi_model import casadi_step
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.layout import (
    LOCAL,
    LOCAL_BEFORE,
    LOCAL_NEXT,
    LOCAL_U,
    LOCAL_X,
    Piece,
    StageLayout,
)
from companion.control.nmpc.parameters import scene_symbols, weight_symbols


@dataclass(frozen=True)
class Stage(StageLayout):
    """The two functions of a stage, with their layout.

    linearise: (x, before, u, x_next, stage, scene, weights) → column of `size` numbers.
    evaluate: the same arguments → (x_{i+1} by the model, cost, margins [m] of agents, cylinders,
    planes).
    """

    linearise: ca.Function
    evaluate: ca.Function


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
    matrices = {
        "gap": reached - after,
        "dynamics": ca.jacobian(reached, ca.vertcat(x, u)),
        "gradient": ca.densify(gradient),
        "hessian": ca.triu(hessian),
        "margin": ca.densify(margins),
        "slope": ca.jacobian(margins, after[:3]),
    }
    pieces, offset = {}, 0
    for name, matrix in matrices.items():
        rows, columns = matrix.sparsity().get_triplet()
        pieces[name] = Piece(offset, np.array(rows, dtype=int), np.array(columns, dtype=int))
        offset += matrix.nnz()
    column = ca.vertcat(*[m.nz[:] for m in matrices.values()])
    linearise = ca.Function("linearise", arguments, [column], {"cse": True})
    outputs = [reached, cost, ca.densify(margins)]
    evaluate = ca.Function("evaluate", arguments, outputs, {"cse": True})
    work = {f.name(): (int(f.sz_iw()), int(f.sz_w())) for f in (linearise, evaluate)}
    return Stage(size=offset, work=work, linearise=linearise, evaluate=evaluate, **pieces)


def majoriser(terms: list[costs.Term], variables: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the gradient of the sum of terms, and the sum of their majorising Hessians."""
    gradient, hessian = ca.SX(LOCAL, 1), ca.SX(LOCAL, LOCAL)
    for term in terms:
        gradient += ca.jacobian(term.residual, variables).T @ term.gradient()
        hessian += term.hessian(variables)
    return gradient, hessian
