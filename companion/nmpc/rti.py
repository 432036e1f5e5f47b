"""The real-time solver: a few full SQP steps from the shifted previous plan.

Everything iterates by count, never by the clock: the same instances give the same bytes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from companion.model import Vector
from companion.nmpc.compiled import CompiledProgram, library
from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance
from companion.nmpc.outcome import Plan, cold_guess, failed, hover, judged, shifted
from companion.nmpc.problem import build_stage
from companion.nmpc.qp import Program
from companion.nmpc.result import Result, Status
from companion.nmpc.stages import Stages

# Length below which a quaternion says nothing.
SMALLEST = 1e-3


class Nmpc:
    """SQP-RTI on the problem of `problem.py`; keeps its own previous plan."""

    def __init__(
        self,
        config: NmpcConfig,
        clock: Callable[[], float] = time.perf_counter,
        *,
        compiled: bool = True,
    ) -> None:
        """Build the solver.

        compiled: use a C compiler if there is one. `backend` says what came of it; the first
        start with a new size of problem then takes seconds, later ones read the cache.
        """
        self.config = config
        self._clock = clock
        stage = build_stage(config)
        found = library(stage, config) if compiled else None
        self.backend = "piqp" if found is None else "compiled"
        self._program: Program | CompiledProgram = (
            Program(config, stage) if found is None else CompiledProgram(config, stage, found)
        )
        linearised = self._program.source[: config.N * stage.size]
        self._stages = Stages(config, stage, linearised, found)
        self._plan: Plan | None = None

    def reset(self) -> None:
        """Forget the previous plan: the next solve starts cold."""
        self._plan = None

    def solve(self, instance: Instance, steps: int = 1) -> Result:
        """Plan from the instance; never raises, never gives a non-finite number.

        steps: ticks since the previous solve, by which its plan is shifted.
        """
        started = self._clock()
        with np.errstate(all="ignore"):
            return self._solve(instance, steps, started)

    def _solve(self, instance: Instance, steps: int, started: float) -> Result:
        config, stages, program = self.config, self._stages, self._program
        cold = self._plan is None
        if self._plan is not None:
            self._plan = shifted(self._plan, steps, config.dt)
        u_last = np.clip(instance.u_last, program.u_min, program.u_max)
        x0 = instance.x0.copy()
        attitude = math.sqrt(float(x0[6:10] @ x0[6:10]))
        # A quaternion of no length is no attitude.
        if not (stages.place(instance, u_last) and attitude > SMALLEST and math.isfinite(x0.sum())):
            return self._failure(instance, Status.NOT_FINITE, 0, started)
        x0[6:10] /= attitude
        guess = self._plan if self._plan is not None else cold_guess(config, instance, x0)
        self._start_from(guess, x0)

        least = config.sqp_iterations
        most = config.sqp_iterations_cold if cold else config.sqp_iterations_max
        iterations, step_norm = 0, math.inf
        while iterations < least or (iterations < most and step_norm > config.step_tolerance):
            stages.linearise()
            found = program.solve(stages.u, u_last)
            if found is None:
                break
            dx, du = found
            largest = float(np.abs(dx).max()), float(np.abs(du).max())
            if not math.isfinite(sum(largest)):
                break
            stages.x[1:] += dx
            stages.u += du
            step_norm = max(largest)
            iterations += 1
        stages.evaluate()
        cost = float(stages.costs.sum())
        # What an earlier iteration found still stands when a later one finds nothing.
        if iterations == 0 or not math.isfinite(cost):
            return self._failure(instance, Status.QP_FAILED, iterations, started)

        x, u = stages.x.copy(), stages.u.copy()
        x[:, :3] += x0[:3]
        q = x[:, 6:10]
        q /= np.sqrt((q * q).sum(axis=1))[:, None]
        self._plan = x, u
        converged = found is not None and step_norm <= config.step_tolerance
        return judged(
            config,
            instance,
            self._plan,
            cost,
            stages.margins,
            status=Status.SOLVED if converged else Status.MAX_ITERATIONS,
            iterations=iterations,
            step_norm=step_norm,
            elapsed=lambda: self._clock() - started,
        )

    def _start_from(self, guess: Plan, x0: Vector) -> None:
        """Set the iterate: relative to x0's place, quaternions on its side of the sphere."""
        stages = self._stages
        stages.x[:], stages.u[:] = guess
        if float(stages.x[0, 6:10] @ x0[6:10]) < 0.0:
            stages.x[:, 6:10] *= -1.0
        stages.x[0] = x0
        stages.x[:, :3] -= x0[:3]

    def _failure(
        self, instance: Instance, status: Status, iterations: int, started: float
    ) -> Result:
        plan = self._plan if self._plan is not None else hover(self.config, instance.x0)
        took = self._clock() - started
        return failed(plan, status=status, iterations=iterations, solve_time=took)
