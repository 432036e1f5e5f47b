"""The own vehicle: its state now, how far it can be trusted, and what the autopilot says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from companion.estimation.autopilot_thrust import AutopilotThrust, AutopilotThrustReader
from companion.estimation.height import Height, HeightEstimator
from companion.estimation.link_quality import LinkQuality
from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.own_doubt import OwnDoubt, OwnDoubtEstimator
from companion.estimation.own_state import OwnState
from companion.estimation.prediction import StatePredictor
from companion.estimation.turns import Turn, UnexplainedTurns
from companion.estimation.velocity_by_sight import VelocityBySight, VelocityFromGround
from companion.estimation.velocity_lag import Lag, VelocityLag
from companion.perception.camera_health import CameraFault
from companion.perception.ground_flow import GroundFlow
from companion.perception.parallax import FixedPoints
from companion.types import Phase
from mavlink_bridge.autopilots.answers import Answers
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import (
    Attitude,
    DistanceSensor,
    Heartbeat,
    HomePosition,
    Message,
    Received,
    Source,
    VehicleState,
)

_UNREPORTED = OwnDoubt()
_NO_LAG = VelocityLag().lag
_UNSEEN = VelocityBySight()
_MODE_KNOWN = 1.0  # s without news for which the last mode is believed: a HEARTBEAT's period
_CLOCK_BACK = 1.0  # s; a vehicle whose clock goes back by more has started anew


@dataclass(frozen=True)
class VehicleEstimate:
    """What is known of the own vehicle at one tick.

    state: now, by the model where telemetry is late; None before telemetry came. age: s, of the
    telemetry; below 0 it is of the future. ahead: samples refused since start, as their stamps are
    of the future. plausible: whether attitude and position can be those of a flying drone.
    packet_loss: share 0…1 of the telemetry of the last second. tick_gap: s since the tick before;
    0: this is the first. heartbeat: the last one. mode_known: whether a heartbeat came since the
    last silence. rebooted: the vehicle has started anew since the tick before. inhibit_reason: why
    this vehicle is not to be flown; empty: it is. thrust: what it tells of its thrust. refusals:
    what the autopilot refused since the tick before, in words. attitudes: those that came since the
    tick before, in order of time. turns: of these, as far as the gyro does not show them. turned:
    rad, to the left, that the told heading has turned by lately and the drone has not: what was
    seen before has to turn by as much about the drone. doubt: of the state. map_offset: (3,) m,
    position on the map less that of the state, see `odometry_frame.py`. height: over ground; None
    before a state is known. lag: of the reported position and velocity, which the state makes up
    for. home: where the vehicle took off, as it tells; None: it has not told. by_sight: what the
    pictures say of the velocity, with which the state is corrected. slid: (3,) m, the part of
    map_offset by steps and slides that the velocity did not show.
    """

    state: VehicleState | None = None
    age: float = float("inf")
    ahead: int = 0
    plausible: bool = True
    packet_loss: float = 0.0
    tick_gap: float = 0.0
    heartbeat: Heartbeat | None = None
    mode_known: bool = False
    rebooted: bool = False
    inhibit_reason: str = ""
    thrust: AutopilotThrust = field(default_factory=AutopilotThrust)
    refusals: tuple[str, ...] = ()
    attitudes: tuple[Attitude, ...] = ()
    turns: tuple[Turn, ...] = ()
    turned: float = 0.0
    doubt: OwnDoubt = _UNREPORTED
    height: Height | None = None
    map_offset: Vector = field(default_factory=lambda: np.zeros(3))
    lag: Lag = _NO_LAG
    home: HomePosition | None = None
    by_sight: VelocityBySight = _UNSEEN
    slid: Vector = field(default_factory=lambda: np.zeros(3))

    def without_news(self, gap: float) -> VehicleEstimate:
        """Return this estimate `gap` [s] later, where no new one can be had.

        The mode is not known for long: a pilot may have changed it.
        """
        age = self.age + gap
        known = self.mode_known and age <= _MODE_KNOWN
        return replace(
            self,
            age=age,
            tick_gap=gap,
            rebooted=False,
            mode_known=known,
            refusals=(),
            attitudes=(),
            turns=(),
            turned=0.0,
        )


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
        self._answers = Answers(identity.adapter)
        self._own = OwnState()
        self._doubt = OwnDoubtEstimator()
        self._height = HeightEstimator()
        self._frame = OdometryFrame()
        self._ground = VelocityFromGround()
        self._turns = UnexplainedTurns()
        self._velocity: Vector = np.zeros(3)  # m/s, of the last tick
        self._height_now: Height | None = None
        self._lag = VelocityLag()
        self._home: HomePosition | None = None
        self._flown_by: StatePredictor | None = None
        self._thrust = AutopilotThrustReader(identity)
        self._link = LinkQuality(silence)
        self._time = -np.inf
        self._reboots = 0

    def update(
        self,
        time: float,
        received: Sequence[Received],
        predictor: StatePredictor,
        phase: Phase,
        horizon: float = math.inf,
    ) -> VehicleEstimate:
        """Return the estimate at the tick of `time` [s], from the messages since the last one.

        predictor: carries a late state to now while the companion flies the vehicle, as the phase
        of the tick before tells. horizon: s, the latest that the vehicle's clock can show.
        """
        heard = [r for r in received if r.source == self._autopilot]
        messages = [r.message for r in heard]
        self._link.hear(time, heard)
        loss = self._link.lost
        doubt = self._doubt.hear(messages)
        before = self._time if np.isfinite(self._time) else time
        by_sight = self._ground.decide(before, self._velocity, doubt)
        self._frame.by_sight = by_sight
        self._own.add(self._frame.localised(messages, doubt.velocity), horizon)
        turns = tuple(self._turns.update(self._own.new_attitudes))
        turned = self._ground.turn(turns) if self._own.rates_by_gyro else 0.0
        self._identity.hear(messages)
        rebooted = self._notice_reboot(time)
        gap = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        self._flown_by = predictor if phase.flying and not rebooted else None
        told = self._state(time)
        self._lag.update(told, phase.flying)
        step = self._lag.step
        if told is not None and step is not None and self._ground.step(step):
            told = replace(told, v=told.v - np.array([*step.change, 0.0]))
            self._lag.corrected(told)
        state = None if told is None else self._lag.lag.made_up(told)
        self._velocity = self._velocity if state is None else state.v
        for m in messages:
            if isinstance(m, HomePosition) and not _same(m, self._home):
                self._home = m
        looks = [m for m in messages if isinstance(m, DistanceSensor)]
        heartbeat = self._identity.heartbeat
        stands = heartbeat is not None and not heartbeat.armed
        self._height_now = (
            None if state is None else self._height.update(state, looks, doubt.height, stands)
        )
        doubt = replace(doubt, velocity=by_sight.sigma)
        return VehicleEstimate(
            state=state,
            age=self._own.age(time),
            ahead=self._own.counters.ahead,
            plausible=self._own.plausible(time),
            packet_loss=loss,
            tick_gap=gap,
            heartbeat=heartbeat,
            mode_known=self._link.knows_mode,
            rebooted=rebooted,
            inhibit_reason=self._identity.inhibit_reason() or doubt.inhibit_reason,
            thrust=self._thrust.read(messages, state),
            refusals=tuple(self._answers.refusals(messages)),
            attitudes=tuple(self._own.new_attitudes),
            turns=turns,
            turned=turned,
            doubt=doubt,
            height=self._height_now,
            map_offset=self._frame.offset,
            slid=self._frame.slid,
            lag=self._lag.lag,
            home=self._home,
            by_sight=by_sight,
        )

    def at(self, time: float) -> VehicleState | None:
        """Return the state at a `time` [s] of the last second; None before telemetry came.

        What telemetry has not told yet is by the model, where the inputs were ours.
        """
        told = self._told(time)
        return None if told is None else self._lag.lag.made_up(told)

    def _told(self, time: float) -> VehicleState | None:
        """Return the state at a `time` [s] as telemetry tells it, its lag included."""
        age = self._own.age(time)
        known = self._own.at(time - age) if age > 0.0 and np.isfinite(age) else None
        if known is None or self._flown_by is None:
            return self._own.at(time)
        return self._flown_by.carried(known, time)

    def see_ground(self, own: VehicleState | None, fixed: FixedPoints, trunks: Vector) -> None:
        """Let the points of a picture, taken in state `own`, correct the height over ground.

        trunks (k,3): known ones, x, y, radius, m.
        """
        if own is not None:
            self._height.see(own, fixed, self._doubt.doubt, trunks)

    def see_flow(self, flow: GroundFlow | None, fault: CameraFault) -> None:
        """Let the ground that passes correct the velocity, from the next message on.

        What a camera that turns out to be misaligned has shown is forgotten.
        """
        if fault is CameraFault.MISALIGNED:
            self._ground = VelocityFromGround()
        if flow is not None and self._height_now is not None:
            before, after = self.at(flow.before), self.at(flow.after)
            if before is not None and after is not None:
                self._ground.see(flow, before, after, self._height_now, self._doubt.doubt)

    def ask(self, requests: Sequence[Message]) -> None:
        """Note what this tick asks of the autopilot, for the words of a refusal."""
        self._answers.ask(requests)

    def _notice_reboot(self, time: float) -> bool:
        """Return whether the vehicle has started anew; what is tied to its clock is forgotten."""
        reboots = self._own.counters.reboots
        rebooted = reboots > self._reboots or time < self._time - _CLOCK_BACK
        self._reboots = reboots
        if rebooted:
            self._time = -np.inf
            self._link = LinkQuality(self._silence)
            self._thrust.reset()
            self._frame = OdometryFrame()
            self._ground = VelocityFromGround()
            self._height.reset()
            self._home = None
            self._lag.reset()
        return rebooted

    def _state(self, time: float) -> VehicleState | None:
        """Return the state now; by the model where telemetry is late and the inputs were ours."""
        return (
            self._own.at(time) if self._own.age(time) <= self._predict_after else self._told(time)
        )


def _same(a: HomePosition, b: HomePosition | None) -> bool:
    """Return whether two messages tell the same home; one that comes again is no new one."""
    if b is None:
        return False
    earth = (a.latitude_deg, a.longitude_deg, a.altitude)
    return earth == (b.latitude_deg, b.longitude_deg, b.altitude) and np.array_equal(a.p, b.p)
