"""The real-time solver: a few full SQP steps from the shifted previous plan.

It needs no line search: every cost term's Hessian majorises it (`costs.py`), and distances are
linearised to their safe side (`constraints.py`). So full steps converge, except where a plan is
pressed hard against the curvature of the dynamics. After more steps than a tick ever takes, for an
optimum, only the part of each step that makes the plan cheaper is taken.

A tick has a limit of work. All iterations end by count, never by the clock: the same instances give
the same plans, bit for bit. Source: Diehl, Bock and Schlöder, "A real-time iteration scheme for
nonlinear optimization in optimal feedback control", 2005.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from companion.control.nmpc.compiled import library, program_library
from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.generated import generated
from companion.control.nmpc.instance import Instance
from companion.control.nmpc.kernel import CompiledProgram
from companion.control.nmpc.layout import StageLayout
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
from companion.control.nmpc.qp import Program
from companion.control.nmpc.stages import Stages
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.arrays import Vector

if TYPE_CHECKING:
    from companion.control.nmpc.problem import Stage

# Length below which a quaternion is no attitude.
LEAST_LENGTH = 1e-3

FULL_STEPS = 20  # from a guess; later steps are shortened
HALVINGS = 10  # of a later step
LEAST_GAIN = 1e-8  # share of the cost that a later step gains; less: the optimum is found

# Of `d_agent_safety`: so far a neighbour is moved for a rival, which passes beyond where it was.
_ASIDE = 0.6

# Work beside iterations, in interior-point iterations: as much time.
_STEP_WORK = 2  # of an SQP step: linearisation


@dataclass
class _Work:
    """The work of a tick, in interior-point iterations: done, of the next step as far as known."""

    limit: int = 0
    done: int = 0
    next_step: int = 0

    @property
    def left(self) -> bool:
        """Return whether the next step stays within the limit."""
        return self.done + self.next_step <= self.limit

    def extend(self, by: int) -> None:
        """Let a further plan of the tick do as much work as `by`."""
        self.limit, self.next_step = self.done + by, 0

    def add_step(self, iterations: int) -> None:
        """Add a step; the next one will be about as hard."""
        self.next_step = iterations + _STEP_WORK
        self.done += self.next_step


@dataclass(frozen=True)
class _Descent:
    """The end of the steps from one guess.

    cost: (29) with penalties. margins (N,rows): m.
    """

    plan: Trajectory
    cost: float
    margins: Vector
    iterations: int
    step_norm: float


class Nmpc:
    """SQP-RTI on the problem of `problem.py`, warm-started from its own previous plan."""

    def __init__(
        self,
        config: NmpcConfig,
        clock: Callable[[], float] = no_clock,
        *,
        compiled: bool = True,
    ) -> None:
        """Build the solver.

        compiled: use a kernel of this problem, or a C compiler if there is one. The first start
        with a new size of problem then takes seconds, later ones read the cache. `backend` says
        what was found: `compiled`; `wheel`, which solves the quadratic programs alone; or `piqp`.
        """
        self.config = config
        self._clock = clock
        made = generated(config) if compiled else None
        found = None if made is None else library(made, config)
        run_by: ctypes.CDLL | Stage
        stage: StageLayout
        if made is not None and found is not None:
            stage, run_by = made.layout, found
        else:
            from companion.control.nmpc.problem import build_stage

            stage = run_by = build_stage(config)
        solving = found or program_library(stage, config)
        self.backend = "compiled" if found else "wheel" if solving else "piqp"
        self._program: Program | CompiledProgram = (
            CompiledProgram(config, stage, solving) if solving else Program(config, stage)
        )
        linearised = self._program.source[: config.N * stage.size]
        self._stages = Stages(config, stage, linearised, run_by)
        self._work = _Work()
        self.reset()

    def reset(self) -> None:
        """Forget the previous plan: the next solve starts cold."""
        self._plan: Trajectory | None = None
        self._rival: Trajectory | None = None

    def solve(self, instance: Instance) -> Plan:
        """Return the plan of an instance, one step after the previous one.

        It never raises, and every number of the plan is finite.
        """
        started = self._clock()
        with np.errstate(all="ignore"):
            return self._solve(instance, started)

    def _solve(self, instance: Instance, started: float) -> Plan:
        config, stages, program = self.config, self._stages, self._program
        self._work = _Work(config.work_max)
        if self._plan is not None:
            self._plan = shifted(self._plan, config.dt)
        u_last = np.clip(instance.u_last, program.u_min, program.u_max)
        x0 = instance.x0.copy()
        attitude = math.sqrt(float(x0[6:10] @ x0[6:10]))
        given = stages.set_parameters(instance, u_last)
        if not (given and attitude > LEAST_LENGTH and math.isfinite(x0.sum())):
            return self._failure(instance, PlanStatus.NOT_FINITE, started)
        x0[6:10] /= attitude
        best = self._best(instance, x0, u_last)
        if best is None:
            return self._failure(instance, PlanStatus.QP_FAILED, started)
        best = self._cheaper(best, instance, x0, u_last)
        self._plan = best.plan
        converged = best.step_norm <= config.step_tolerance
        return usable_plan(
            config,
            instance,
            best.plan,
            best.cost,
            best.margins,
            status=PlanStatus.SOLVED if converged else PlanStatus.MAX_ITERATIONS,
            iterations=best.iterations,
            step_norm=best.step_norm,
            elapsed=lambda: self._clock() - started,
        )

    def _best(self, instance: Instance, x0: Vector, u_last: Vector) -> _Descent | None:
        """Return the descent from the previous plan; where it fails, from a cold guess."""
        config, best = self.config, None
        if self._plan is not None:
            best = self._descend(
                self._plan, x0, u_last, config.sqp_iterations, config.sqp_iterations_max
            )
        if best is None:
            guess = cold_guess(config, instance, x0)
            most = config.sqp_iterations_cold
            best = self._descend(guess, x0, u_last, config.sqp_iterations, most)
        return best

    def _cheaper(self, best: _Descent, instance: Instance, x0: Vector, u_last: Vector) -> _Descent:
        """Return the plan, or a much cheaper one past the other side of who it comes too near to.

        Descent ends in the minimum next to its guess. So in one tick a rival is planned, with that
        neighbour moved to the side on which it is passed, and in the next tick planned on with it
        where it is. No tick plans more than twice.
        """
        config = self.config
        self._work.extend(config.work_max)
        steps = config.sqp_iterations, config.sqp_iterations_max
        rival, self._rival = self._rival, None
        if rival is not None:
            found = self._descend(shifted(rival, config.dt), x0, u_last, *steps)
            if found is not None and found.cost < config.route_gain * best.cost:
                return found
            return best
        agents = best.margins[:, : config.neighbours]
        if not config.route_gain or agents.min(initial=math.inf) > -config.route_intrusion:
            return best
        k, j = divmod(int(agents.argmin()), config.neighbours)
        p, by = best.plan[0][k + 1, :3], _ASIDE * config.d_agent_safety
        other = instance.past_other_side(j, p, (k + 1) * config.dt, by)
        if self._stages.set_parameters(other, u_last):
            found = self._descend(best.plan, x0, u_last, *steps)
            self._rival = None if found is None else found.plan
        return best

    def _descend(
        self, guess: Trajectory, x0: Vector, u_last: Vector, least: int, most: int
    ) -> _Descent | None:
        """Return the end of `least`…`most` steps from a guess; None where all fail.

        Where a later step fails, the earlier ones stand.
        """
        config, stages = self.config, self._stages
        self._start_from(guess, x0)
        iterations, step_norm = 0, math.inf
        while iterations < least or (
            iterations < most and step_norm > config.step_tolerance and self._work.left
        ):
            if iterations >= FULL_STEPS:
                stages.roll_out()
            stages.linearise()
            found = self._program.solve(stages.u, u_last, again=iterations > 0)
            self._work.add_step(abs(self._program.iterations))
            if found is None:
                step_norm = math.inf
                break
            dx, du = found
            largest = float(np.abs(dx).max()), float(np.abs(du).max())
            if not math.isfinite(sum(largest)):
                step_norm = math.inf
                break
            step_norm = max(largest)
            iterations += 1
            if iterations <= FULL_STEPS:
                stages.x[1:] += dx
                stages.u += du
            elif not self._improve(du):
                step_norm = 0.0
        cost = self._cost()
        if iterations == 0 or not math.isfinite(cost):
            return None
        x = stages.x.copy()
        x[:, :3] += x0[:3]
        q = x[:, 6:10]
        q /= np.sqrt((q * q).sum(axis=1))[:, None]
        return _Descent(
            (x, stages.u.copy()), cost, stages.margins.copy(), iterations, min(step_norm, 1e9)
        )

    def _improve(self, du: Vector) -> bool:
        """Take the largest part of a step that makes the roll-out cheaper; return whether any."""
        stages = self._stages
        u, cost = stages.u.copy(), self._cost()
        for halvings in range(HALVINGS):
            stages.u[:] = u + 0.5**halvings * du
            stages.roll_out()
            if self._cost() < cost - LEAST_GAIN * (1.0 + cost):
                return True
        stages.u[:] = u
        stages.roll_out()
        return False

    def _cost(self) -> float:
        """Return (29) with the penalties, at the iterate."""
        stages = self._stages
        stages.evaluate()
        return float(stages.costs.sum()) + penalty(self.config, stages.margins)

    def _start_from(self, guess: Trajectory, x0: Vector) -> None:
        """Set the iterate, relative to the position of x0, with quaternions of its sign."""
        stages = self._stages
        stages.x[:], stages.u[:] = guess
        if float(stages.x[0, 6:10] @ x0[6:10]) < 0.0:
            stages.x[:, 6:10] *= -1.0
        stages.x[0] = x0
        stages.x[:, :3] -= x0[:3]

    def _failure(self, instance: Instance, status: PlanStatus, started: float) -> Plan:
        self._rival = None  # of a tick that is gone
        plan = self._plan if self._plan is not None else hover(self.config, instance.x0)
        took = self._clock() - started
        return failed_plan(plan, status=status, iterations=0, solve_time=took)
