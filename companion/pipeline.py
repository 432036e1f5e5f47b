"""One tick, from what came in to what goes out: the page to read first.

    telemetry ─► vehicle ──────────────┬─────────► motion (delay, hover thrust) ─┐
    frame ─────► perception ─► obstacles ─► neighbours ─► guidance ──────────────┴─► NMPC
                                                                                     │
                               SET_ATTITUDE_TARGET ◄─ actuation ◄─ guard, phases ◄───┘

Nothing is decided here: each stage takes what it needs and returns a frozen result, and the log
record is made from these results. No I/O and no clock: the time of a tick is given, and the
stop-watch is passed in.
"""

from __future__ import annotations

from collections.abc import Callable

from companion.control.actuation import Actuation
from companion.control.baselines import make_planner
from companion.control.formulation import Formulation
from companion.control.planning import Planning
from companion.estimation.known_obstacles import ObstacleEstimator
from companion.estimation.motion import MotionEstimator
from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.vehicle import VehicleEstimator
from companion.guidance.guidance import Guidance
from companion.perception.frontend import PerceptionFrontend, make_view
from companion.settings.config import CompanionConfig
from companion.stage_clock import StageClock
from companion.supervision.supervision import Supervision
from companion.tick import Tick, TickInputs
from mavlink_bridge.autopilots.registry import Identity, adapter
from mavlink_bridge.shared.thrust import ThrustMap


class Companion:
    """Everything that one drone knows and decides, tick by tick."""

    def __init__(self, config: CompanionConfig, stopwatch: Callable[[], float]) -> None:
        """Build all stages; stopwatch: s, for the times of the stages alone.

        Raises:
            CalibrationError, ModelError: a file of the camera or a detector that cannot be used.
        """
        c = config.for_controller()
        link, hover = c.link, ThrustMap(c.airframe.hover_thrust, c.airframe.thrust_exponent)
        planner = make_planner(c.controller, c.nmpc, c.baselines, c.right_of_way.level, stopwatch)
        formulation = Formulation(c.nmpc, c.fence, c.reciprocity, c.timing.delay)
        view = make_view(c.camera, c.sensing)
        self._stopwatch = stopwatch
        self._vehicle = VehicleEstimator(
            Identity(link.autopilot, link.system_id),
            link.system_id,
            silence=c.guard.stale_silent,
            predict_after=c.guard.stale_predict,
        )
        self._perception = PerceptionFrontend(view, c.sensing, c.camera_health)
        self._obstacles = ObstacleEstimator(view, c.obstacles, c.surfaces)
        self._neighbours = NeighbourEstimator(view, c.tracker)
        self._motion = MotionEstimator(hover, c.timing.delay)
        self._guidance = Guidance(c.guidance())
        self._planning = Planning(c.nmpc, planner, formulation)
        self._supervision = Supervision(
            c.guard, c.mission, c.fence, adapter(link.autopilot, link.system_id)
        )
        self._actuation = Actuation(link.system_id, self._motion)

    def tick(self, inputs: TickInputs) -> Tick:
        """Decide once. The same inputs in the same order give the same results."""
        run = StageClock(self._stopwatch)
        time, frame = inputs.time, inputs.frame
        vehicle = run(
            "vehicle",
            self._vehicle.update,
            time,
            inputs.received,
            self._motion.predictor,
            self._supervision.phase,
        )
        if vehicle.rebooted:
            self._start_over()
        own, phase = vehicle.state, self._supervision.phase
        seen = run("see", self._perception.see, time, frame, self._vehicle.at)
        obstacles = run("map", self._obstacles.update, seen, own)
        tracks = run("track", self._neighbours.update, time, seen, obstacles)
        motion = run("motion", self._motion.update, own, phase)
        reference = run("guide", self._guidance.decide, own, tracks, obstacles, seen.fault, phase)
        planned = run("plan", self._planning.plan, own, reference, motion.prediction)
        supervised = run(
            "supervise",
            self._supervision.decide,
            time,
            vehicle,
            seen,
            reference,
            planned.plan,
            self_tested=planned.self_tested,
            leave=inputs.leave,
        )
        setpoint = run(
            "command",
            self._actuation.setpoint,
            time,
            supervised.command,
            motion.thrust_map,
            supervised.in_control,
        )
        results = (vehicle, seen, obstacles, tracks, motion, reference, planned, supervised)
        return Tick(time, *results, setpoint, run.taken)

    def _start_over(self) -> None:
        """Forget what is tied to the vehicle's clock and place: it has started anew."""
        for stage in (
            self._perception,
            self._obstacles,
            self._neighbours,
            self._motion,
            self._guidance,
            self._supervision,
        ):
            stage.reset()
