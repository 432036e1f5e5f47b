"""Planning: a reference and a prediction in, the instance and its plan out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.control.baselines import Planner
from companion.control.formulation import Formulation
from companion.control.nmpc import Instance, NmpcConfig, make_instance
from companion.estimation.prediction import Prediction, state_vector
from companion.guidance.guidance import Reference
from companion.model import yaw_of
from companion.types import Plan
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import VehicleState


@dataclass(frozen=True)
class Planned:
    """What came of planning at one tick.

    instance and plan: None where the companion does not fly. self_tested: whether the solver has
    solved its self-test.
    """

    instance: Instance | None = None
    plan: Plan | None = None
    self_tested: bool = False


class Planning:
    """Asks the planner for a plan while the companion flies, and tests it before."""

    def __init__(self, nmpc: NmpcConfig, planner: Planner, formulation: Formulation) -> None:
        self._nmpc = nmpc
        self._planner = planner
        self._formulation = formulation
        self._self_tested = False

    @property
    def backend(self) -> str:
        """Name of the NMPC's solver (`Nmpc.backend`); empty for another controller."""
        return str(getattr(self._planner, "backend", ""))

    def plan(
        self,
        own: VehicleState | None,
        reference: Reference | None,
        prediction: Prediction | None,
    ) -> Planned:
        """Return the plan of this tick.

        prediction: None where the companion does not fly; then the solver is tested, once.
        """
        if own is None or reference is None:
            return Planned(self_tested=self._self_tested)
        if prediction is None:
            self._self_tested = self._self_tested or self._self_test(own)
            return Planned(self_tested=self._self_tested)
        instance = self._formulation.instance(own, reference, prediction)
        return Planned(instance, self._planner.solve(instance), self._self_tested)

    def _self_test(self, own: VehicleState) -> bool:
        """Return whether the solver works, before anything depends on it: hover here, all clear."""
        instance = make_instance(
            self._nmpc,
            x0=state_vector(own),
            u_last=np.array([GRAVITY, 0.0, 0.0, 0.0]),
            goal=own.p,
            yaw=yaw_of(own.q_wb),
        )
        usable = self._planner.solve(instance).usable
        self._planner.reset()
        return usable
