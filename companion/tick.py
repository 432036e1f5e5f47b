"""The inputs of one tick, and the results of all its stages."""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.control.planning import Planned
from companion.estimation.delay import Delay
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.motion import MotionEstimate
from companion.estimation.vehicle import VehicleEstimate
from companion.estimation.vehicle_clock import ClockEstimate
from companion.guidance.guidance import Reference
from companion.perception.frontend import Detections
from companion.services.services import Served
from companion.supervision.guard import Broken
from companion.supervision.supervision import Supervised
from companion.types import Track
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Message, RateSetpoint, Received
from mavlink_bridge.wire.video import Frame


@dataclass(frozen=True)
class TickInputs:
    """All that a tick depends on, besides what earlier ticks left.

    time: s, vehicle's clock. received: messages since the last tick. frame: the newest one. leave:
    control is to be given back to the autopilot. latest: s, the latest that the vehicle's clock can
    show while the inputs are read; None: the time of the tick. clock: where it is estimated, for
    log and journal.
    """

    time: float
    received: list[Received]
    frame: Frame | None
    leave: bool = False
    latest: float | None = None
    clock: ClockEstimate | None = None

    @property
    def horizon(self) -> float:
        """The latest time [s, vehicle's clock] that a stamp can truly have."""
        return self.time if self.latest is None else self.latest


@dataclass(frozen=True)
class Tick:
    """The results of all stages of one tick, and how long each took [s].

    reference: None before the own state is known. setpoint: None where none goes out. failure: the
    stage that raised, in words; empty: none did. broken: the gravest assumption that does not hold.
    beyond: bounds of the certificate that neighbours or obstacles broke, in words.
    """

    time: float
    vehicle: VehicleEstimate = field(default_factory=VehicleEstimate)
    seen: Detections = field(default_factory=Detections)
    obstacles: KnownObstacles = field(default_factory=KnownObstacles)
    tracks: list[Track] = field(default_factory=list)
    motion: MotionEstimate = field(
        default_factory=lambda: MotionEstimate(
            None, HoverEstimate(ThrustMap(), 1.0), Delay(0.0, 0.0)
        )
    )
    reference: Reference | None = None
    planned: Planned = field(default_factory=Planned)
    supervised: Supervised = field(default_factory=Supervised)
    served: Served = field(default_factory=Served)
    setpoint: RateSetpoint | None = None
    stages: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    broken: Broken | None = None
    beyond: tuple[str, ...] = ()

    @property
    def packets(self) -> list[list[Message]]:
        """The messages to send, by packets; on a lossy link setpoint and requests three times."""
        setpoint: list[Message] = [] if self.setpoint is None else [self.setpoint]
        flies = [*self.supervised.requests, *setpoint]
        return [[*flies, *self.served.messages], *[flies] * (2 if self.supervised.repeat else 0)]
