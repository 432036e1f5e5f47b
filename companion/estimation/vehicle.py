"""The own vehicle: its state now, how far it can be trusted, and what the autopilot says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.estimation.link_quality import LinkQuality
from companion.estimation.own_state import OwnState
from companion.estimation.prediction import StatePredictor
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.wire.messages import Heartbeat, Received, Source, VehicleState

_CLOCK_BACK = 1.0  # s; a vehicle whose clock goes back by more has started anew


@dataclass(frozen=True)
class VehicleEstimate:
    """What is known of the own vehicle at one tick.

    state: now, by the model where telemetry is late; None before telemetry came. age: s, of the
    telemetry. plausible: whether attitude and position can be those of a flying drone.
    packet_loss: share 0…1 of the telemetry of the last
    second. tick_gap: s since the tick before; 0: this is the first. heartbeat: the last one.
    mode_known: whether a heartbeat came since the last silence. rebooted: the vehicle has started
    anew since the tick before. inhibit_reason: why this vehicle is not to be flown; empty: it is.
    """

    state: VehicleState | None = None
    age: float = float("inf")
    plausible: bool = True
    packet_loss: float = 0.0
    tick_gap: float = 0.0
    heartbeat: Heartbeat | None = None
    mode_known: bool = False
    rebooted: bool = False
    inhibit_reason: str = ""


class VehicleEstimator:
    """Follows the telemetry of one autopilot."""

    def __init__(
        self, identity: Identity, system_id: int, silence: float, predict_after: float
    ) -> None:
        """silence: s, see `LinkQuality`. predict_after: s, age from which the model predicts."""
        self._identity = identity
        self._autopilot = Source(system_id, 1)
        self._silence = silence
        self._predict_after = predict_after
        self._own = OwnState()
        self._link = LinkQuality(silence)
        self._time = -np.inf
        self._reboots = 0

    def update(
        self,
        time: float,
        received: Sequence[Received],
        predictor: StatePredictor,
        phase: Phase,
    ) -> VehicleEstimate:
        """Return the estimate at the tick of `time` [s], from the messages since the last one.

        predictor: carries a late state to now while the companion flies the vehicle, as the phase
        of the tick before tells.
        """
        heard = [r for r in received if r.source == self._autopilot]
        messages = [r.message for r in heard]
        self._link.hear(time, heard)
        loss = self._link.lost
        self._own.add(messages)
        self._identity.hear(messages)
        rebooted = self._notice_reboot(time)
        gap = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        return VehicleEstimate(
            state=self._state(time, predictor if phase.flying and not rebooted else None),
            age=self._own.age(time),
            plausible=self._own.plausible(time),
            packet_loss=loss,
            tick_gap=gap,
            heartbeat=self._identity.heartbeat,
            mode_known=self._link.knows_mode,
            rebooted=rebooted,
            inhibit_reason=self._identity.inhibit_reason(),
        )

    def at(self, time: float) -> VehicleState | None:
        """Return the state at a `time` [s] of the last second; None before telemetry came."""
        return self._own.at(time)

    def _notice_reboot(self, time: float) -> bool:
        """Return whether the vehicle has started anew; what is tied to its clock is forgotten."""
        reboots = self._own.counters.reboots
        rebooted = reboots > self._reboots or time < self._time - _CLOCK_BACK
        self._reboots = reboots
        if rebooted:
            self._time = -np.inf
            self._link = LinkQuality(self._silence)
        return rebooted

    def _state(self, time: float, predictor: StatePredictor | None) -> VehicleState | None:
        """Return the state now; by the model where telemetry is late and the inputs were ours."""
        age = self._own.age(time)
        known = self._own.at(time - age) if np.isfinite(age) else None
        if known is None or predictor is None or age <= self._predict_after:
            return self._own.at(time)
        return predictor.carried(known, time)
