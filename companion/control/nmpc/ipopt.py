"""The reference solver: the same problem, converged by IPOPT, for tests, studies, benchmarks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from companion.control.nmpc.outcome import (
    Trajectory,
    cold_guess,
    failed_plan,
    hover,
    no_clock,
    penalty,
    shifted,
    usable_plan,
)
from companion.control.nmpc.parameters import ParameterVectors, weight_numbers
from companion.control.nmpc.problem import build_stage
from companion.control.nmpc.qp import change_bounds, input_bounds
from companion.model import NU, NX, normalise
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.arrays import Vector

INFINITY = float("inf")

# CasADi takes Ctrl-C for itself and ends the solve by one of these: it is no failed solve.
_INTERRUPTED = ("User_Requested_Stop", "NonIpopt_Exception_Thrown")


class IpoptNmpc:
    """Multiple shooting on the stage functions of `problem.py`, solved to convergence.

    expand: the MX graph to SX, which is faster. barrier: IPOPT's first barrier parameter; a small
    one finds the minimum next to the guess rather than a better one farther off.
    """

    def __init__(
        self,
        config: NmpcConfig,
        clock: Callable[[], float] = no_clock,
        *,
        expand: bool = True,
        barrier: float = 0.1,
    ) -> None:
        self.config = config
        self._clock = clock
        self._stage = build_stage(config)
        self._weights = weight_numbers(config)
        self._parameters = ParameterVectors(config)
        self._build(expand, barrier)
        self._plan: Trajectory | None = None

    def _build(self, expand: bool, barrier: float) -> None:
        config, N, stage = self.config, self.config.N, self._stage
        X, U = ca.MX.sym("X", NX, N), ca.MX.sym("U", NU, N)
        count = stage.evaluate.size1_out(2)
        slack = ca.MX.sym("slack", count, N)
        x0, u_last = ca.MX.sym("x0", NX), ca.MX.sym("u_last", NU)
        stages = ca.MX.sym("stages", stage.linearise.nnz_in(4), N)
        scene = ca.MX.sym("scene", stage.linearise.nnz_in(5))
        weights = ca.MX.sym("weights", len(self._weights))
        cost, rows, low, high = ca.MX(0), [], [], []
        change = change_bounds(config)
        for k in range(N):
            before = U[:, k - 1] if k > 0 else u_last
            x = X[:, k - 1] if k > 0 else x0
            arguments = (x, before, U[:, k], X[:, k], stages[:, k], scene, weights)
            reached, stage_cost, margins = stage.evaluate(*arguments)
            cost += stage_cost + self._penalty(slack[:, k])
            first = 0 if k < config.M_constraint else config.neighbours
            low += [0.0] * NX + [-c for c in change] + [0.0] * (count - first)
            high += [0.0] * NX + [*change] + [INFINITY] * (count - first)
            rows += [reached - X[:, k], U[:, k] - before, (margins + slack[:, k])[first:]]
        self._low, self._high = np.array(low), np.array(high)
        problem: Any = {
            "x": ca.veccat(X, U, slack),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": ca.veccat(x0, u_last, stages, scene, weights),
        }
        # The bounds that the real-time solver plans within: one problem, one optimum.
        least, most = input_bounds(config)
        bounds = np.full(NX * N, INFINITY)
        self._least = np.concatenate([-bounds, np.tile(least, N), np.zeros(count * N)])
        self._most = np.concatenate([bounds, np.tile(most, N), np.full(count * N, INFINITY)])
        options: Any = {
            "expand": expand,
            "print_time": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": 1e-8,
                "max_iter": 500,
                "mu_init": barrier,
            },
        }
        self._solver = ca.nlpsol("reference", "ipopt", problem, options)

    def _penalty(self, slack: ca.MX) -> ca.MX:
        linear, quadratic = self.config.penalty, self.config.penalty_quadratic
        return linear * ca.sum1(slack) + 0.5 * quadratic * ca.sumsqr(slack)

    def reset(self) -> None:
        """Forget the previous plan."""
        self._plan = None

    def guess(self, plan: Trajectory) -> None:
        """Start the next solve from `plan`, which is of the same instance."""
        x, u = plan
        self._plan = (
            np.concatenate([x[:1], x[:-1]]),
            np.concatenate([u[:1], u[:-1]]),
        )

    def solve(self, instance: Instance) -> Plan:
        """Return the converged plan of an instance, one step after the previous one.

        It never raises, and every number of the plan is finite.
        """
        started = self._clock()
        with np.errstate(all="ignore"):
            return self._solve(instance, started)

    def _solve(self, instance: Instance, started: float) -> Plan:
        config, N = self.config, self.config.N
        if self._plan is not None:
            self._plan = shifted(self._plan, config.dt)
        low, high = self._least[NX * N :][:NU], self._most[NX * N :][:NU]
        u_last = np.clip(instance.u_last, low, high)
        x0 = instance.x0.copy()
        x0[6:10] = normalise(x0[6:10])
        self._parameters.fill(instance)
        scene, stages = self._parameters.scene, self._parameters.stages.T
        if not all(np.isfinite(a).all() for a in (x0, u_last, scene, stages)):
            return self._failure(instance, PlanStatus.NOT_FINITE, 0, started)
        x, u = self._plan if self._plan is not None else cold_guess(config, instance, x0)
        x = x.copy()
        if float(x[0, 6:10] @ x0[6:10]) < 0.0:
            x[:, 6:10] *= -1.0
        origin = np.concatenate([x0[:3], np.zeros(7)])
        slack = np.full(len(self._least) - (NX + NU) * N, 1e-3)
        start = np.concatenate([(x[1:] - origin).ravel(), u.ravel(), slack])
        here = x0 - origin
        parameters = np.concatenate([here, u_last, stages.T.ravel(), scene, self._weights])
        try:
            answer = self._solver(
                x0=start,
                p=parameters,
                lbx=self._least,
                ubx=self._most,
                lbg=self._low,
                ubg=self._high,
            )
        except RuntimeError as error:  # CasADi has taken Ctrl-C for itself before it began
            if "KeyboardInterrupt" in str(error):
                raise KeyboardInterrupt from error
            raise
        statistics = self._solver.stats()
        if statistics["return_status"] in _INTERRUPTED:
            raise KeyboardInterrupt
        iterations = int(statistics["iter_count"])
        values = answer["x"].full()
        if values is None:  # CasADi has taken Ctrl-C for itself while it copied the answer
            raise KeyboardInterrupt
        solution = values.ravel()
        if not (statistics["success"] and np.isfinite(solution).all()):
            return self._failure(instance, PlanStatus.INFEASIBLE, iterations, started)
        x = np.concatenate([here[None], solution[: NX * N].reshape(N, NX)])
        u = solution[NX * N : (NX + NU) * N].reshape(N, NU)
        cost, margins = self._evaluate(x, u, u_last, stages, scene)
        x = x + origin
        x[:, 6:10] = normalise(x[:, 6:10])
        self._plan = x, u
        return usable_plan(
            config,
            instance,
            self._plan,
            cost,
            margins,
            status=PlanStatus.SOLVED,
            iterations=iterations,
            step_norm=0.0,
            elapsed=lambda: self._clock() - started,
        )

    def _evaluate(
        self, x: Vector, u: Vector, u_last: Vector, stages: Vector, scene: Vector
    ) -> tuple[float, Vector]:
        """Return the cost (29) with penalties and the margins (N,rows) of a plan."""
        N = self.config.N
        before = np.concatenate([u_last[None], u[:-1]])
        shared = [np.tile(c[:, None], N) for c in (scene, self._weights)]
        columns = (x[:-1].T, before.T, u.T, x[1:].T, stages, *shared)
        _, costs, margins = self._stage.evaluate.map(N)(*columns)
        margins = margins.full().T
        return float(costs.full().sum()) + penalty(self.config, margins), margins

    def _failure(
        self, instance: Instance, status: PlanStatus, iterations: int, started: float
    ) -> Plan:
        plan = self._plan if self._plan is not None else hover(self.config, instance.x0)
        took = self._clock() - started
        return failed_plan(plan, status=status, iterations=iterations, solve_time=took)
