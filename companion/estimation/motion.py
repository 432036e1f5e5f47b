"""Motion under our own inputs: the prediction for the controller, and the hover thrust."""

from __future__ import annotations

from dataclasses import dataclass

from companion.estimation.hover_thrust import HoverThrust
from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import Prediction, StatePredictor
from companion.types import Phase
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import VehicleState


@dataclass(frozen=True)
class MotionEstimate:
    """What follows from the inputs sent; prediction: None where the companion does not fly."""

    prediction: Prediction | None
    thrust_map: ThrustMap


class MotionEstimator:
    """Learns from the inputs sent and the motion that they caused."""

    def __init__(self, prior: ThrustMap, delay: float) -> None:
        """prior: thrust map as configured. delay: s, from a tick to its effect."""
        self._history = InputHistory(delay)
        self._hover_thrust = HoverThrust(prior, self._history)
        self.reset()

    def reset(self) -> None:
        """Forget what is tied to the vehicle's clock; the hover thrust is kept."""
        self._history.clear()
        self.predictor = StatePredictor(self._history)

    def update(self, own: VehicleState | None, phase: Phase) -> MotionEstimate:
        """Return the estimate at one tick; learn from the motion while our inputs fly."""
        if own is None or not phase.flying:
            return MotionEstimate(None, self._hover_thrust.map)
        prediction = self.predictor.update(own)
        return MotionEstimate(prediction, self._hover_thrust.update(own))

    def sent(self, sent: SentInput) -> None:
        """Remember an input that was sent."""
        self._history.add(sent)

    def clear(self) -> None:
        """Forget the inputs sent: from here on the autopilot flies by itself."""
        self._history.clear()
