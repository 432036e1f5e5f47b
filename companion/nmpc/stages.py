"""The stage functions over all stages at once, called on arrays that stay in place."""

from __future__ import annotations

import casadi as ca
import numpy as np

from companion.model import NU, NX, Vector
from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance
from companion.nmpc.parameters import scene_numbers, stage_numbers, weight_numbers
from companion.nmpc.problem import Stage


class Stages:
    """An iterate (x, u), the parameters, and the stage functions evaluated on them.

    All arrays are read and written in place by the generated functions; fill them, never
    replace them. `source` is where the linearisation goes.
    """

    def __init__(self, config: NmpcConfig, stage: Stage, source: Vector) -> None:
        N = config.N
        self.config = config
        self.x, self.u = np.zeros((N + 1, NX)), np.zeros((N, NU))
        self.reached, self.costs = np.zeros((N, NX)), np.zeros(N)
        self.margins = np.zeros((N, stage.evaluate.nnz_out(2)))
        self._before = np.zeros((N, NU))
        self._stage = np.zeros((N, stage.linearise.nnz_in(4)))
        self._scene = np.zeros(stage.linearise.nnz_in(5))
        self._weights = weight_numbers(config)
        inputs = [
            self.x[:-1],
            self._before,
            self.u,
            self.x[1:],
            self._stage,
            self._scene,
            self._weights,
        ]
        shared = [5, 6]
        linearise = stage.linearise.map("linearise_all", "serial", N, shared, [])
        evaluate = stage.evaluate.map("evaluate_all", "serial", N, shared, [])
        self._buffers = []
        self._linearise = self._bind(linearise, inputs, [source])
        self._evaluate = self._bind(evaluate, inputs, [self.reached, self.costs, self.margins])

    def _bind(self, function: ca.Function, inputs: list[Vector], outputs: list[Vector]):
        buffer, call = function.buffer()
        for i, array in enumerate(inputs):
            buffer.set_arg(i, memoryview(array.reshape(-1)))
        for i, array in enumerate(outputs):
            buffer.set_res(i, memoryview(array.reshape(-1)))
        self._buffers.append(buffer)
        return call

    def place(self, instance: Instance, u_last: Vector) -> bool:
        """Set the parameters of an instance; False if one of them is not finite."""
        with np.errstate(all="ignore"):
            self._scene[:] = scene_numbers(self.config, instance)
            self._stage[:] = stage_numbers(self.config, instance).T
        self._before[0] = u_last
        given = (self._scene, self._stage, self._before[0])
        return all(bool(np.isfinite(array).all()) for array in given)

    def linearise(self) -> None:
        """Fill `source` at the iterate."""
        self._before[1:] = self.u[:-1]
        self._linearise()

    def evaluate(self) -> None:
        """Fill `reached`, `costs` and `margins` at the iterate."""
        self._before[1:] = self.u[:-1]
        self._evaluate()
