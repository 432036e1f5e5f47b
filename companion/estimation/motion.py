"""Motion under our own inputs: the prediction for the controller, and the hover thrust."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from companion.estimation.autopilot_thrust import AutopilotThrust
from companion.estimation.delay import Delay, DelayEstimator
from companion.estimation.hover_thrust import HoverEstimate, HoverThrust
from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import Prediction, StatePredictor
from companion.types import Phase
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Attitude, VehicleState


@dataclass(frozen=True)
class MotionEstimate:
    """What follows from the inputs sent.

    prediction: None where the companion does not fly. delay: from a tick to its effect.
    """

    prediction: Prediction | None
    hover: HoverEstimate
    delay: Delay

    @property
    def thrust_map(self) -> ThrustMap:
        """Thrust for an acceleration."""
        return self.hover.map


class MotionEstimator:
    """Learns from the inputs sent and the motion that they caused."""

    def __init__(
        self,
        prior: ThrustMap,
        doubt: float,
        delay: float,
        curve_known: bool = False,
        drag: float = 0.0,
    ) -> None:
        """prior, doubt, curve_known: as for `HoverThrust`. delay: s; drag: 1/s; as configured."""
        self._drag = drag
        self._history = InputHistory(delay)
        self._delay = DelayEstimator(delay)
        self._hover_thrust = HoverThrust(prior, doubt, self._history, curve_known)
        self.reset()

    def reset(self) -> None:
        """Forget what is tied to the vehicle's clock; hover thrust and delay are kept."""
        self.clear()
        self._hover_thrust.reset()
        self.predictor = StatePredictor(self._history, self._drag)

    def update(
        self,
        own: VehicleState | None,
        attitudes: Iterable[Attitude],
        told: AutopilotThrust,
        phase: Phase,
    ) -> MotionEstimate:
        """Return the estimate at one tick; learn from the motion.

        attitudes: those that telemetry brought since the last tick, in order of time. told: what
        the vehicle tells of its thrust, which counts until our inputs fly.
        """
        # In LAND the autopilot may fly already: HEARTBEAT tells it up to a second later.
        hover = self._hover_thrust.update(own, told, ours=phase is Phase.FLY)
        if own is not None and told.airborne and phase in (Phase.WAIT, Phase.TAKEOFF, Phase.ENGAGE):
            self.predictor.watch(own)
        if own is None or not phase.flying:
            return MotionEstimate(None, hover, self._delay.estimate)
        delay = self._delay.measured(own.time, attitudes)
        self._history.delay, self._history.delay_sigma = delay.value, delay.sigma
        return MotionEstimate(self.predictor.update(own), hover, delay)

    def sent(self, sent: SentInput) -> None:
        """Remember an input that was sent."""
        self._history.add(sent)
        self._delay.sent(sent)

    def clear(self) -> None:
        """Forget the inputs sent: from here on the autopilot flies by itself."""
        self._history.clear()
        self._delay.reset()
