"""One tick, from what came in to what goes out: the page to read first.

    telemetry ─► vehicle ──────────────┬─────────► motion (delay, hover thrust) ─┐
    frame ─────► perception ─► obstacles ─► neighbours ─► guidance ──────────────┴─► NMPC
                                                                                     │
                               SET_ATTITUDE_TARGET ◄─ actuation ◄─ guard, phases ◄───┘

Nothing is decided here: each stage takes what it needs and returns a frozen result, and the log
record is made from these results. Where a stage raises, a result that claims nothing stands in for
its own, and the guard brakes and asks for HOLD. No I/O and no clock: the time of a tick is given,
and the stop-watch is passed in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.control.actuation import Actuation
from companion.control.baselines import ControllerSetup, make_planner
from companion.control.formulation import Formulation
from companion.control.planning import Planned, Planning
from companion.estimation.delay import Delay
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.known_obstacles import ObstacleEstimator
from companion.estimation.motion import MotionEstimate, MotionEstimator
from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.vehicle import VehicleEstimate, VehicleEstimator
from companion.guidance.goals import resolved
from companion.guidance.guidance import Guidance, Reference
from companion.perception.frontend import Detections, PerceptionFrontend, make_view
from companion.perception.ground_plane import LEVEL
from companion.services.services import Served, Services, Situation, Wish, nearest
from companion.settings.config import CompanionConfig
from companion.stage_clock import StageClock
from companion.supervision.certify import Certifier
from companion.supervision.guard import Broken
from companion.supervision.last_resort import LastResort
from companion.supervision.monitors import Monitors
from companion.supervision.phases import GiveBack
from companion.supervision.supervision import Supervised, Supervision
from companion.supervision.surroundings import Surroundings, SurroundingsEstimator
from companion.tick import Tick, TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Identity, adapter
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import RateCommand, RateSetpoint, Source

_GIVE_BACK = {
    Wish.HOLD: GiveBack.HOLD,
    Wish.RETURN: GiveBack.RETURN,
    Wish.LAND: GiveBack.LAND,
}


def _nothing() -> None:
    """Stand in for a result that may be missing."""


class Companion:
    """Everything that one drone knows and decides, tick by tick."""

    def __init__(self, config: CompanionConfig, stopwatch: Callable[[], float]) -> None:
        """Build all stages; stopwatch: s, for the times of the stages alone.

        Raises:
            CalibrationError, ModelError: a file of the camera or a detector that cannot be used.
        """
        c = config.for_controller()
        link, airframe = c.link, c.airframe
        setup = ControllerSetup(
            c.nmpc, c.baselines, c.right_of_way.level, stopwatch, c.controller_options
        )
        planner = make_planner(c.controller, setup)
        formulation = Formulation(c.nmpc, c.fence)
        view = make_view(c.camera, c.sensing)
        self._stopwatch = stopwatch
        self._vehicle = VehicleEstimator(
            Identity(link.autopilot, link.system_id),
            link.system_id,
            silence=c.guard.stale_silent,
            predict_after=c.guard.stale_predict,
        )
        self._perception = PerceptionFrontend(
            view, c.sensing, c.camera_health, c.camera.lag, measuring=c.mission.commission
        )
        self._obstacles = ObstacleEstimator(view, c.obstacles, c.surfaces)
        self._neighbours = NeighbourEstimator(view, c.tracker)
        prior = ThrustMap(airframe.hover_thrust, airframe.exponent)
        self._motion = MotionEstimator(
            prior,
            airframe.hover_doubt,
            c.timing.delay,
            curve_known=airframe.thrust_exponent is not None,
            drag=airframe.drag,
        )
        self._guidance = Guidance(c.guidance())
        self._planning = Planning(c.nmpc, planner, formulation)
        self._supervision = Supervision(
            c.guard,
            c.mission,
            c.fence,
            adapter(link.autopilot, link.system_id),
            Certifier(c.certificate, c.guard, airframe.radius, c.slow),
        )
        self._surroundings = SurroundingsEstimator(c.certificate, c.fence, view)
        self._monitors = Monitors(c.monitors, c.nmpc.v_max)
        own = Source(link.system_id, link.component_id)
        ways = {Wish.HOLD, Wish.LAND}
        if adapter(link.autopilot, link.system_id).rtl():
            ways.add(Wish.RETURN)
        goals = [g.p for g in resolved(c.mission.goals, None) or []]
        self._services = Services(own, c.camera, c.fence, goals, frozenset(ways))
        self._before = Situation(Phase.WAIT)  # of the last tick, as the services tell it
        self._last_resort = LastResort(adapter(link.autopilot, link.system_id))
        self._actuation = Actuation(link.system_id, self._motion)
        self._system_id, self._hover = link.system_id, c.airframe.hover_thrust
        hover = HoverEstimate(prior, airframe.hover_doubt)
        self._last = Tick(-np.inf, motion=MotionEstimate(None, hover, Delay(c.timing.delay, 0.0)))
        self._failed_late = ""  # a failure that supervision has not been told of

    @property
    def solver(self) -> str:
        """Name of the NMPC's solver (`Planning.backend`)."""
        return self._planning.backend

    def tick(self, inputs: TickInputs) -> Tick:
        """Decide once. The same inputs in the same order give the same results.

        A stage that raises an exception ends in a command of the guard, never in the exception.
        """
        run = StageClock(self._stopwatch)
        time, frame, last = inputs.time, inputs.frame, self._last
        vehicle = run(
            "vehicle",
            lambda: last.vehicle.without_news(time - last.time),
            self._vehicle.update,
            time,
            inputs.received,
            self._motion.predictor,
            self._supervision.phase,
            inputs.horizon,
        )
        if vehicle.rebooted:
            run("start over", _nothing, self._start_over)
        own, phase = vehicle.state, self._supervision.phase
        ground = LEVEL if vehicle.height is None else vehicle.height.ground
        served = run("serve", Served, self._services.update, time, inputs.received, self._before)
        if served.goals is not None:
            run("set goals", _nothing, self._guidance.set_goals, served.goals)
        known = last.obstacles.widest
        seen = run(
            "see",
            Detections,
            self._perception.see,
            time,
            frame,
            self._vehicle.at,
            ground,
            inputs.horizon,
            known,
            vehicle.doubt.wander,
            self._neighbours.lately,
            last.time,
        )
        if seen.fault.misleads and not phase.on_mission:
            run("forget", _nothing, self._forget_seen)
        run("height", _nothing, self._vehicle.see_ground, seen.own, seen.fixed, known)
        run("velocity", _nothing, self._vehicle.see_flow, seen.flow, seen.fault)
        if vehicle.turned and own is not None:
            run("turn", _nothing, self._turn, own.p, vehicle.turned)
        obstacles = run(
            "map", lambda: last.obstacles, self._obstacles.update, seen, own, vehicle.doubt, ground
        )
        tracks = run(
            "track",
            lambda: last.tracks,
            self._neighbours.update,
            time,
            seen,
            obstacles,
            on_mission=phase.on_mission,
        )
        motion = run(
            "motion",
            lambda: replace(last.motion, prediction=None),
            self._motion.update,
            own,
            vehicle.attitudes,
            vehicle.thrust,
            phase,
        )
        reference = run(
            "guide",
            _nothing,
            self._guidance.decide,
            own,
            tracks,
            obstacles,
            seen.fault,
            phase,
            vehicle.map_offset,
            motion.delay,
            vehicle.height,
            vehicle.home,
            self._neighbours.surprises(time),
            self._neighbours.steady,
            self._neighbours.clear_share,
        )
        planned = run("plan", Planned, self._planning.plan, own, reference, motion.prediction)
        broken = run(
            "watch",
            _nothing,
            self._monitors.update,
            time,
            vehicle,
            motion,
            phase,
            obstacles.blank,
            reference is not None and reference.alone,
            self._neighbours.surprises(time),
            obstacles.upsets,
        )
        surroundings = run(
            "look round",
            _nothing,
            self._surroundings.update,
            time,
            own,
            seen,
            obstacles,
            tracks,
            vehicle.map_offset,
            phase,
            ground,
        )
        supervised = self._supervise(
            run,
            inputs,
            vehicle,
            seen,
            reference,
            planned,
            motion,
            surroundings,
            broken,
            served.wish,
        )
        run("ask", _nothing, self._vehicle.ask, supervised.requests)
        setpoint = run(
            "command",
            lambda: self._plain_setpoint(time, supervised.command),
            self._actuation.setpoint,
            time,
            supervised.command,
            motion.thrust_map,
            motion.delay,
            supervised.in_control,
        )
        reason = supervised.verdict.reason if supervised.verdict else None
        self._before = Situation(
            supervised.phase,
            reason,
            len(tracks),
            seen.fault,
            nearest(own, tracks),
            motion.hover.doubt,
            vehicle.packet_loss,
            -1 if reference is None else reference.progress.index,
            supervised.inhibit_reason or (broken.finding if broken else ""),
        )
        self._services.took(sum(run.taken.values()))
        results = (vehicle, seen, obstacles, tracks, motion, reference, planned, supervised)
        told = supervised.inhibit_reason
        self._failed_late = "" if told else run.failure
        limits = () if surroundings is None else surroundings.broken
        self._last = Tick(time, *results, served, setpoint, run.taken, run.failure, broken, limits)
        return self._last

    def _supervise(
        self,
        run: StageClock,
        inputs: TickInputs,
        vehicle: VehicleEstimate,
        seen: Detections,
        reference: Reference | None,
        planned: Planned,
        motion: MotionEstimate,
        surroundings: Surroundings | None,
        broken: Broken | None,
        wish: Wish | None,
    ) -> Supervised:
        """Return what supervision decides; where it fails itself, hold is requested."""
        failure = run.failure or self._failed_late
        supervised = run(
            "supervise",
            _nothing,
            self._supervision.decide,
            inputs.time,
            vehicle,
            seen,
            reference,
            planned.plan,
            motion,
            surroundings,
            self_tested=planned.self_tested,
            leave=inputs.leave,
            give_back=None if wish is None else _GIVE_BACK.get(wish),
            resume=wish is Wish.RESUME,
            failure=failure,
            broken=broken,
        )
        if supervised is None:
            phase, heartbeat = self._last.supervised.phase, vehicle.heartbeat
            return self._last_resort.decide(inputs.time, phase, heartbeat, run.failure)
        return supervised

    def _plain_setpoint(self, time: float, command: RateCommand | None) -> RateSetpoint | None:
        """Return a level setpoint at the configured hover thrust; None where none is to go out."""
        if command is None:
            return None
        return RateSetpoint(time, np.zeros(3), self._hover, self._system_id)

    def _turn(self, p: Vector, angle: float) -> None:
        """Turn trunks, points and tracks about p (3,) m, as the told heading turned, by `angle`."""
        self._obstacles.turn(p, angle)
        self._neighbours.turn(p, angle)

    def _forget_seen(self) -> None:
        """Forget what the camera has shown: it may have been at fault for long.

        Only while no mission is flown: nothing depends on it, and a look round comes before one. A
        drone with a camera upside down, taken over, fled from what it had seen at take-off.
        """
        self._obstacles.reset()
        self._neighbours.reset()

    def _start_over(self) -> None:
        """Forget what is tied to the vehicle's clock and place: it has started anew."""
        for stage in (
            self._perception,
            self._obstacles,
            self._neighbours,
            self._motion,
            self._guidance,
            self._surroundings,
            self._supervision,
            self._services,
        ):
            stage.reset()
