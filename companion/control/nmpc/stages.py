"""The stage functions over all stages at once, called on arrays that stay in place."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from companion.control.nmpc.kernel import Sweep
from companion.control.nmpc.layout import StageLayout
from companion.control.nmpc.parameters import ParameterVectors, weight_numbers
from companion.model import NU, NX, step
from mavlink_bridge.shared.arrays import Vector

if TYPE_CHECKING:
    import casadi as ca

    from companion.control.nmpc.problem import Stage


class Stages:
    """An iterate x (N+1,10), u (N,4), the parameters, and the stage functions on them.

    The generated functions read and write all arrays in place: fill them, never replace them.
    reached (N,10): x_1…x_N by the model. costs (N,). margins (N,rows) m: of (37), (38).
    """

    def __init__(
        self,
        config: NmpcConfig,
        stage: StageLayout,
        source: Vector,
        run_by: ctypes.CDLL | Stage,
    ) -> None:
        """source: receives the linearisation.

        run_by: the library with the functions, or the stage for CasADi's virtual machine.
        """
        N = config.N
        self.config = config
        self.x, self.u = np.zeros((N + 1, NX)), np.zeros((N, NU))
        self.reached, self.costs = np.zeros((N, NX)), np.zeros(N)
        self.margins = np.zeros((N, len(stage.margin.rows)))
        self._before = np.zeros((N, NU))
        self._parameters = ParameterVectors(config)
        self._weights = weight_numbers(config)
        inputs = [
            (self.x[:-1], NX),
            (self._before, NU),
            (self.u, NU),
            (self.x[1:], NX),
            (self._parameters.stages, self._parameters.stages.shape[1]),
            (self._parameters.scene, 0),
            (self._weights, 0),
        ]
        outputs = [(self.reached, NX), (self.costs, 1), (self.margins, self.margins.shape[1])]
        linear = [(source, stage.size)]
        self._linearise: Callable[[], None]
        self._evaluate: Callable[[], None]
        if isinstance(run_by, ctypes.CDLL):
            work = stage.work
            self._linearise = Sweep(run_by, "linearise", work["linearise"], N, inputs, linear)
            self._evaluate = Sweep(run_by, "evaluate", work["evaluate"], N, inputs, outputs)
        else:
            self._buffers: list[object] = []
            self._linearise = self._bind(run_by.linearise, inputs, linear)
            self._evaluate = self._bind(run_by.evaluate, inputs, outputs)

    def _bind(
        self,
        function: ca.Function,
        inputs: list[tuple[Vector, int]],
        outputs: list[tuple[Vector, int]],
    ) -> Callable[[], None]:
        """Return a call of the function on all stages in CasADi's virtual machine."""
        shared = [i for i, (_, stride) in enumerate(inputs) if stride == 0]
        name = function.name() + "_all"
        mapped = function.map(name, "serial", self.config.N, shared, [])
        buffer: Any
        buffer, call = mapped.buffer()
        for i, (array, _) in enumerate(inputs):
            buffer.set_arg(i, _memory(array))
        for i, (array, _) in enumerate(outputs):
            buffer.set_res(i, _memory(array))
        self._buffers.append(buffer)
        return call  # type: ignore[no-any-return]

    def set_parameters(self, instance: Instance, u_last: Vector) -> bool:
        """Set the parameters to those of an instance; return whether all are finite."""
        self._parameters.fill(instance)
        self._before[0] = u_last
        # A sum is finite only if every term is; a sum that overflows has no plan either.
        given = self._parameters
        total = given.scene.sum() + given.stages.sum() + self._before[0].sum()
        return math.isfinite(total)

    def roll_out(self) -> None:
        """Replace x_1…x_N by the states that the inputs lead to from x_0."""
        disturbance, x = self._parameters.of_scene["disturbance"].tolist(), self.x[0].tolist()
        for k, u in enumerate(self.u.tolist()):
            x = self.x[k + 1] = step(x, u, self.config.dt, disturbance)

    def linearise(self) -> None:
        """Fill `source` at the iterate."""
        self._before[1:] = self.u[:-1]
        self._linearise()

    def evaluate(self) -> None:
        """Fill `reached`, `costs` and `margins` at the iterate."""
        self._before[1:] = self.u[:-1]
        self._evaluate()


def _memory(array: Vector) -> Any:
    """Return the memory of an array; CasADi's stubs know only the C side of its buffers."""
    flat = array.reshape(-1)
    assert np.shares_memory(flat, array) or not array.size
    return memoryview(flat)  # type: ignore[arg-type]
