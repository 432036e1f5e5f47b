"""Supervision: the guard's verdict and the phase, from what one tick knows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from companion.estimation.motion import MotionEstimate
from companion.estimation.vehicle import VehicleEstimate
from companion.guidance.fence import FenceConfig
from companion.guidance.guidance import Reference
from companion.guidance.mission import MissionConfig
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import Detections
from companion.supervision.certify import Certified, Certifier
from companion.supervision.guard import (
    AutopilotRequest,
    Broken,
    Guard,
    GuardInputs,
    Reason,
    Verdict,
)
from companion.supervision.guard_config import GuardConfig
from companion.supervision.phases import GiveBack, PhaseMachine
from companion.supervision.surroundings import Surroundings
from companion.types import Phase, Plan
from mavlink_bridge.autopilots.registry import Autopilot
from mavlink_bridge.wire.messages import Message, RateCommand

# Commands that come from a plan. The others brake or level already, for reasons that come first.
_PLANNED = (Reason.PLAN, Reason.LOSSY, Reason.SHIFTED_PLAN, Reason.BLIND, Reason.ASSUMPTION)
_FOUND_FLYING = (
    "it flew in offboard before this companion started: a pilot must choose another mode"
)


@dataclass(frozen=True)
class Supervised:
    """What supervision decided at one tick.

    requests: messages to the autopilot. verdict: the
    guarded command; None where no setpoint is to go out. repeat: the link loses packets, so that a
    setpoint is sent three times. certified: the certificate of the command, None where none is
    asked for: without a command, or without a state.
    """

    phase: Phase = Phase.WAIT
    requests: list[Message] = field(default_factory=list)
    verdict: Verdict | None = None
    repeat: bool = False
    inhibit_reason: str = ""
    certified: Certified | None = None

    @property
    def command(self) -> RateCommand | None:
        """The command of the setpoint that goes out; None: none does."""
        silent = self.verdict is None or self.verdict.request is AutopilotRequest.SILENCE
        return None if self.verdict is None or silent else self.verdict.command

    @property
    def in_control(self) -> bool:
        """Whether the vehicle follows the setpoints, as far as its heartbeat tells."""
        return self.verdict is not None and self.phase is not Phase.ENGAGE


class Supervision:
    """The guard and the phase machine, and what passes between them."""

    def __init__(
        self,
        guard: GuardConfig,
        mission: MissionConfig,
        fence: FenceConfig,
        autopilot: Autopilot,
        certifier: Certifier,
    ) -> None:
        self._config = guard
        self._fence = fence
        self._guard = Guard(guard)
        self._phases = PhaseMachine(mission, autopilot)
        self._certifier = certifier

    @property
    def phase(self) -> Phase:
        """The phase of the last tick."""
        return self._phases.phase

    def reset(self) -> None:
        """Give control up: the vehicle has started anew, and nothing on it is ours."""
        self._phases.rebooted()
        self._certifier.reset()

    def decide(
        self,
        time: float,
        vehicle: VehicleEstimate,
        seen: Detections,
        reference: Reference | None,
        plan: Plan | None,
        motion: MotionEstimate,
        surroundings: Surroundings | None = None,
        *,
        self_tested: bool,
        leave: bool,
        give_back: GiveBack | None = None,
        resume: bool = False,
        failure: str = "",
        broken: Broken | None = None,
    ) -> Supervised:
        """Return the verdict and the phase at the tick of `time` [s]; one call a tick.

        motion: the hover thrust, without which the companion does not take over, and the state
        from which the command acts. surroundings: what the command must keep clear of.
        self_tested: the solver works. leave: control is to be given back to the autopilot.
        give_back: a ground station asks for that, and how. resume: it asks the companion to stand
        by for the vehicle again. failure: the stage that failed, in
        words; empty: none. broken: the gravest assumption that does not hold.
        """
        inhibit_reason = failure or vehicle.inhibit_reason or seen.inhibit_reason
        if reference is not None:
            inhibit_reason = inhibit_reason or reference.inhibit_reason
        verdict: Verdict | None = None
        if resume:
            self._phases.resume()
        if leave:
            self._phases.release()
        if give_back is not None:
            self._phases.release(give_back)
        if self.phase.flying:
            verdict = self._judge(time, vehicle, seen, plan, motion, failure, broken)
            if verdict.request is not AutopilotRequest.NONE:
                holds = verdict.request is AutopilotRequest.HOLD
                stays = vehicle.doubt.position <= self._config.hold_doubt
                self._phases.release(GiveBack.HOLD if holds and stays else GiveBack.LAND)
        decision = self._phases.update(
            time,
            vehicle.heartbeat if vehicle.mode_known else None,
            vehicle.state,
            ready=self_tested and not inhibit_reason and self._fit_to_fly(vehicle, seen),
            complete=reference is not None and reference.land,
            known=motion.hover.known,
            airborne=vehicle.thrust.airborne,
        )
        if self._phases.waits_for_thrust and not inhibit_reason:
            inhibit_reason = motion.hover.unknown_reason
        if self._phases.waits_for_pilot and not inhibit_reason:
            inhibit_reason = _FOUND_FLYING
        requests = list(decision.requests)
        if not decision.stream:
            verdict = None
        elif verdict is None:
            verdict = self._judge(time, vehicle, seen, plan, motion, failure, broken)
        repeat = vehicle.packet_loss > self._config.lossy
        v_max = math.inf if reference is None else reference.v_max
        verdict, certified = self._certified(verdict, motion, surroundings, v_max)
        return Supervised(decision.phase, requests, verdict, repeat, inhibit_reason, certified)

    def _certified(
        self,
        verdict: Verdict | None,
        motion: MotionEstimate,
        surroundings: Surroundings | None,
        v_max: float,
    ) -> tuple[Verdict | None, Certified | None]:
        """Return the verdict, of which a plan's command flies only with a certificate; and that."""
        prediction = motion.prediction
        if verdict is None or prediction is None or surroundings is None:
            return verdict, None
        certified = self._certifier.certify(
            verdict.command, prediction, surroundings.scene, motion.delay, v_max
        )
        if certified is None or certified.instead is None or verdict.reason not in _PLANNED:
            return verdict, certified
        return replace(verdict, command=certified.instead, reason=Reason.UNCERTIFIED), certified

    def _fit_to_fly(self, vehicle: VehicleEstimate, seen: Detections) -> bool:
        """Return whether what is known of vehicle and camera is new and can be true."""
        return (
            seen.started
            and seen.fault is CameraFault.NONE
            and 0.0 <= vehicle.age <= self._config.stale_stop
            and vehicle.plausible
        )

    def _judge(
        self,
        time: float,
        vehicle: VehicleEstimate,
        seen: Detections,
        plan: Plan | None,
        motion: MotionEstimate,
        failure: str,
        broken: Broken | None,
    ) -> Verdict:
        own, ahead = vehicle.state, motion.prediction
        acting = None
        if own is not None and ahead is not None:
            x = ahead.x0
            acting = replace(own, time=own.time + ahead.delay, p=x[:3], v=x[3:6], q_wb=x[6:10])
        outside, outward = -np.inf, 0.0
        if own is not None:
            outside, outward = self._fence.across(own.p + vehicle.map_offset, own.v)
        return self._guard.judge(
            GuardInputs(
                time,
                plan,
                own,
                acting=acting,
                age=vehicle.age,
                plausible=vehicle.plausible,
                outside=outside,
                outward=outward,
                blind=seen.blind,
                misled=seen.fault is CameraFault.MISALIGNED,
                tick_gap=vehicle.tick_gap,
                packet_loss=vehicle.packet_loss,
                failure=failure,
                broken=broken,
                wind=None if ahead is None else ahead.disturbance,
            )
        )
