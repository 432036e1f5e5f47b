"""What a solve gives: always finite, never an exception."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from companion.model import Vector


class Status(Enum):
    """How a solve ended."""

    SOLVED = "solved"  # converged: the last step was small
    MAX_ITERATIONS = "max_iterations"  # usable, but the last step was still large
    QP_FAILED = "qp_failed"  # the quadratic program found no solution
    INFEASIBLE = "infeasible"  # the reference solver proved or gave up on feasibility
    NOT_FINITE = "not_finite"  # a number of the instance or of the plan is not finite


@dataclass(frozen=True)
class Result:
    """A plan and how good it is.

    x (N+1,10) and u (N,4): the plan, in the instance's frame; x[0] is x0 (q perhaps negated,
    the same attitude). usable: the plan is of this instance; if not, x and u are the shifted
    previous plan, or hover where there is none, and somebody else decides. iterations: SQP (or
    IPOPT) iterations. solve_time [s], by the clock given. step_norm: largest change of any
    variable in the last iteration. slack_*: deepest intrusion [m] of the plan into what (37),
    (38) keep free. active: names of the constraints the plan leans on. cost: (29) with the
    penalties.
    """

    x: Vector
    u: Vector
    status: Status
    usable: bool
    iterations: int
    solve_time: float
    step_norm: float
    slack_agent: float
    slack_obstacle: float
    slack_plane: float
    active: tuple[str, ...]
    cost: float
