"""One tick, from what came in to what goes out: the page to read first.

    frame ─► see ─► track ─► threat (≤ 3 critical) ─┐
       └──► obstacles (seen or remembered) ─────────┤
    telemetry ─► own state ─► mission ─► gaze ──────┴─► NMPC ─► guard ─► setpoint

No I/O and no clock here: the time of a tick is given, and the stop-watch is passed in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from companion.control.baselines import make_planner
from companion.control.nmpc import Instance, Neighbour, make_instance
from companion.estimation.hover_thrust import Lift
from companion.estimation.link_quality import LinkWatch
from companion.estimation.obstacle_map import ObstacleMap
from companion.estimation.own_state import OwnState
from companion.estimation.prediction import Forecast
from companion.estimation.surface_map import Surfaces
from companion.estimation.tracker import Tracker
from companion.guidance.detour import Detour
from companion.guidance.landing import Landing
from companion.guidance.line_of_sight import Gaze, bearing, close_by, seen_speed
from companion.guidance.reciprocity import yielding
from companion.guidance.threat import (
    calm_speed,
    doubt,
    in_the_way,
    rated_neighbours,
    uncrowded_speed,
    way_past,
)
from companion.guidance.waypoints import Mission, Progress
from companion.model import yaw_of
from companion.perception.camera_health import Eye, Trouble
from companion.perception.frontend import Sight, Sighting
from companion.settings.config import CompanionConfig, adapted
from companion.supervision.guard import Ask, Guard, Situation, Verdict
from companion.supervision.phases import COMPANION_HEARTBEAT, Phase, Phases
from companion.types import Obstacles, Result, Track
from mavlink_bridge.autopilots.registry import Identity, adapter
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.thrust import G, ThrustMap
from mavlink_bridge.wire.messages import (
    Heartbeat,
    Message,
    RateSetpoint,
    Received,
    Source,
    VehicleState,
)
from mavlink_bridge.wire.video import Frame

_HEARTBEAT_PERIOD = 1.0
_CLOCK_BACK = 1.0  # s; a vehicle whose clock goes back by more has started anew
_COPIES = 2  # of a setpoint, besides the first


@dataclass(frozen=True)
class TickInputs:
    """All that a tick depends on: its time [s, vehicle's clock], messages, the latest frame."""

    time: float
    received: list[Received]
    frame: Frame | None
    leave: bool = False  # control is to be given back to the autopilot


@dataclass
class TickOutputs:
    """What goes out, and all that the log shows of how it came about."""

    time: float
    messages: list[Message] = field(default_factory=list)
    lossy: bool = False  # the line: one packet may not do
    phase: Phase = Phase.WAIT
    heartbeat: Heartbeat | None = None
    rehearsed: bool = False
    own: VehicleState | None = None
    trouble: Trouble = Trouble.NONE  # with the camera
    sighting: Sighting = field(default_factory=Sighting)
    tracks: list[Track] = field(default_factory=list)
    near: list[tuple[Track, float]] = field(default_factory=list)
    critical: list[tuple[Track, float]] = field(default_factory=list)
    obstacles: Obstacles = field(default_factory=Obstacles.none)
    progress: Progress | None = None
    aim: Vector = field(default_factory=lambda: np.zeros(3))  # the goal, or a way round
    yaw: float = 0.0
    speed: float = 0.0
    instance: Instance | None = None
    result: Result | None = None
    verdict: Verdict | None = None
    hover_thrust: float = 0.0
    objection: str = ""  # why this vehicle is not to be flown, one line
    stages: dict[str, float] = field(default_factory=dict)

    @property
    def packets(self) -> list[list[Message]]:
        """What goes out, packet by packet: all, and on a lossy line the setpoint again."""
        setpoint: list[Message] = [m for m in self.messages if isinstance(m, RateSetpoint)]
        return [self.messages, *[setpoint] * (_COPIES if self.lossy else 0)]


class Pipeline:
    """Everything one drone knows and decides, tick by tick."""

    def __init__(self, config: CompanionConfig, stopwatch: Callable[[], float]) -> None:
        config = adapted(config)
        self._config = config
        self._stopwatch = stopwatch
        self._own = OwnState()
        self._sight = Sight(config.camera, config.sensing)
        self._mission = Mission(config.mission)
        link = config.link
        self._identity = Identity(link.autopilot, link.system_id)
        self._phases = Phases(config.mission, adapter(link.autopilot, link.system_id))
        self._planner = make_planner(
            config.controller, config.nmpc, config.baselines, config.threat.level, stopwatch
        )
        self._guard = Guard(config.guard)
        self._lift = Lift(
            ThrustMap(config.airframe.hover_thrust, config.airframe.thrust_exponent),
            config.timing.delay,
        )
        self._rehearsed = False
        self._start_over()

    def _start_over(self) -> None:
        """Forget what is tied to the vehicle's clock and place, as at start."""
        config = self._config
        self._time = self._frame_time = self._heartbeat_sent = -np.inf
        self._held = 0.0
        self._watch = LinkWatch(config.guard.stale_silent)
        self._reboots = self._own.counters.reboots
        self._eye = Eye(config.eye, self._sight.needs)
        self._tracker = Tracker(config.tracker)
        self._map = ObstacleMap(config.obstacles)
        self._surfaces = Surfaces(self._sight.camera, config.surfaces)
        self._detour = Detour(config.fence.sides())
        self._gaze = Gaze(config.gaze)
        self._landing = Landing(config.mission, config.nmpc.d_agent_safety)
        self._forecast = Forecast(config.timing.delay)

    def tick(self, inputs: TickInputs) -> TickOutputs:
        """Decide once. The same inputs in the same order give the same outputs."""
        out = TickOutputs(inputs.time)
        self._timed(out, "state", self._read_telemetry, inputs, out)
        self._timed(out, "see", self._see, inputs, out)
        self._timed(out, "track", self._track, out)
        if out.own is not None:
            self._timed(out, "aim", self._aim, out)
            self._timed(out, "plan", self._plan, out)
        self._timed(out, "command", self._command, inputs, out)
        return out

    # --- the stages, in order ------------------------------------------------------------

    def _read_telemetry(self, inputs: TickInputs, out: TickOutputs) -> None:
        """Own state now, from what the autopilot said."""
        autopilot = Source(self._config.link.system_id, 1)
        heard = [r for r in inputs.received if r.source == autopilot]
        mine = [r.message for r in heard]
        self._watch.hear(inputs.time, heard)
        out.lossy = self._watch.lost > self._config.guard.lossy
        self._own.add(mine)
        self._identity.hear(mine)
        out.objection = self._identity.objection()
        out.heartbeat = self._identity.heartbeat
        self._notice_reboot(inputs.time)
        out.own = self._own_now(inputs.time)

    def _see(self, inputs: TickInputs, out: TickOutputs) -> None:
        """Neighbours and trunks in the frame, in the camera's frame; each frame once."""
        frame = inputs.frame
        out.trouble = self._eye.look(inputs.time, frame, self._sight.fits(frame))
        if frame is not None and frame.time > self._frame_time and self._eye.shows:
            at_capture = self._own.at(frame.time)
            if at_capture is not None:
                self._frame_time = frame.time
                out.sighting = self._sight.see(frame, at_capture)
        out.objection = out.objection or self._sight.objection

    def _track(self, out: TickOutputs) -> None:
        """Neighbours with velocity and covariance, obstacles seen or remembered."""
        sighting, q_bc = out.sighting, self._sight.camera.mount
        if sighting.own is not None:
            if sighting.searched:
                self._map.update(
                    sighting.trunks, sighting.own, q_bc, self._sight.half_view,
                    tells=partial(self._sight.tells, sighting),
                )  # fmt: skip
            if sighting.ranges is not None:
                self._surfaces.update(sighting.ranges, sighting.own)
            self._tracker.predict(out.sighting.time)
            places = self._tracker.positions()
            hidden = self._map.hidden(sighting.own.p, places)
            in_view = [v and not h for v, h in zip(self._sight.in_view(sighting.own, places),
                                                   hidden, strict=True)]  # fmt: skip
            self._tracker.update(sighting.time, sighting.drones, sighting.own, q_bc, in_view)
        self._tracker.predict(out.time)
        out.tracks = self._tracker.tracks()

    def _aim(self, out: TickOutputs) -> None:
        """Where to go and where to look; what is in the way."""
        own = out.own
        assert own is not None
        mine = self._phases.phase in (Phase.FLY, Phase.LAND)
        surveyed = self._gaze.surveyed
        out.progress = self._mission.update(own, surveyed) if mine else Progress(own.p, 0, False)
        cylinders = self._map.obstacles(own.p).cylinders
        points = self._surfaces.points(cylinders)
        room = self._config.nmpc.d_obstacle_safety
        goal = self._detour.aim(own.p, out.progress.goal, cylinders, room)
        rough = self._config.surfaces.rough
        goal = out.aim = self._surfaces.lane(own.p, goal, points, room - rough)
        yaw_now = yaw_of(own.q_wb)
        out.near = rated_neighbours(own, out.tracks, self._config.threat)
        out.critical = out.near[: self._config.threat.critical]
        lost = [bearing(own.p, t) for t, _ in out.critical if t.lost]
        close = close_by(own.p, out.tracks, self._config.gaze)
        out.yaw = (
            self._gaze.update(out.time, own.v, goal - own.p, yaw_now, lost, close)
            if mine
            else self._gaze.rest(out.time, yaw_now)
        )
        cruise = self._config.nmpc.speed
        out.speed = min(
            cruise * seen_speed(self._config.gaze, yaw_now, goal - own.p),
            uncrowded_speed(own, out.tracks, goal - own.p, cruise, self._config.threat),
        )
        if out.trouble is not Trouble.NONE:
            out.speed = min(out.speed, self._config.guard.blind_speed)
        out.obstacles = Obstacles(cylinders, self._surfaces.planes(own.p, goal, points), points)

    def _plan(self, out: TickOutputs) -> None:
        """Solve eq. (11)–(38) from where the drone will be when the input takes effect."""
        own, config = out.own, self._config
        assert own is not None
        if not self._flying:
            self._rehearsed = out.rehearsed = self._rehearsed or self._rehearse(own)
            return
        goal = out.aim
        critical = {t.id for t, _ in out.critical}
        self._forecast.observe(own)
        self._lift.observe(own)
        out.instance = make_instance(
            config.nmpc,
            x0=self._forecast.ahead(own),
            u_last=self._forecast.u_last,
            goal=way_past(own, out.tracks, out.obstacles.cylinders, goal, config.threat),
            yaw=out.yaw,
            speed=out.speed,
            v_max=calm_speed(own, out.tracks, out.speed, config.nmpc.v_max, config.threat),
            # Distance (37) is kept to whoever is near, or a drone that dodges one neighbour flies
            # into the fourth. Cohesion is with the critical ones that fly the same way: at its
            # distance nobody gets past one that stands in the way.
            neighbours=[
                self._neighbour(
                    own, t, t.id in critical and not in_the_way(own, t, goal, config.threat)
                )
                for t, _ in out.near
            ],
            cylinders=out.obstacles.cylinders,
            # The first few are kept: walls before the fence, which the guard minds too.
            planes=np.vstack(
                [
                    config.fence.altitude_planes(goal[2]),
                    out.obstacles.planes,
                    config.fence.near(own.p, config.nmpc.d_obstacle_safety),
                ]
            ),
            disturbance=self._forecast.disturbance,
        )
        out.result = self._planner.solve(out.instance)

    def _command(self, inputs: TickInputs, out: TickOutputs) -> None:
        """Requests to the autopilot, and the setpoint where it is ours to send."""
        complete = out.progress is not None and out.progress.complete and self._flying
        if complete and out.own is not None:
            complete = self._landing.may(out.own, out.tracks, self._gaze)
        if inputs.leave:
            self._phases.release()
        if self._flying:
            out.verdict = self._judge(out)
            if out.verdict.ask is not Ask.NOTHING:
                self._phases.release(land=out.verdict.ask is not Ask.HOLD)
        heartbeat = self._identity.heartbeat if self._watch.knows_mode else None
        decision = self._phases.update(out.time, heartbeat, out.own, self._ready(out), complete)
        out.phase = decision.phase
        out.messages += decision.requests
        if out.time - self._heartbeat_sent >= _HEARTBEAT_PERIOD:
            self._heartbeat_sent = out.time
            out.messages.append(COMPANION_HEARTBEAT)
        if decision.stream:
            self._stream(out)
        else:
            out.verdict = None
        if not decision.stream or decision.phase is Phase.ENGAGE:
            # What was sent is not what flies: the autopilot follows it once it is in offboard.
            self._forecast.forget()
            self._lift.forget()
        out.hover_thrust = self._lift.map.hover_thrust

    # --- parts of stages -----------------------------------------------------------------

    def _notice_reboot(self, time: float) -> None:
        """A vehicle that starts anew is another one: nothing is known, nothing is ours."""
        if self._own.counters.reboots > self._reboots or time < self._time - _CLOCK_BACK:
            self._start_over()
            self._lift.forget()
            self._phases.rebooted()
        self._held = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time

    def _own_now(self, time: float) -> VehicleState | None:
        """Own state; by the model where telemetry is late and the commands were ours."""
        age = self._own.age(time)
        known = self._own.at(time - age) if np.isfinite(age) else None
        if known is None or not self._flying or age <= self._config.guard.stale_predict:
            return self._own.at(time)
        return self._forecast.carried(known, time)

    def _ready(self, out: TickOutputs) -> bool:
        """Whether control may be taken: everything works, what is known is new and can be true."""
        return (
            self._frame_time > -np.inf
            and out.trouble is Trouble.NONE
            and self._rehearsed
            and self._own.age(out.time) <= self._config.guard.stale_stop
            and self._own.believable(out.time)
            and not out.objection
        )

    def _rehearse(self, own: VehicleState) -> bool:
        """Whether the solver works, before anything depends on it: to stay here, all clear."""
        instance = make_instance(
            self._config.nmpc,
            x0=np.concatenate([own.p, own.v, own.q_wb]),
            u_last=np.array([G, 0.0, 0.0, 0.0]),
            goal=own.p,
            yaw=yaw_of(own.q_wb),
        )
        usable = self._planner.solve(instance).usable
        self._planner.reset()
        return usable

    @property
    def _flying(self) -> bool:
        return self._phases.phase in (Phase.ENGAGE, Phase.FLY, Phase.LAND)

    def _neighbour(self, own: VehicleState, track: Track, company: bool) -> Neighbour:
        """A track as the NMPC wants it, carried over the delay, giving way; eq. (13)."""
        nmpc = self._config.nmpc
        scale = nmpc.agent_vertical_scale
        over = (track.p[2] - own.p[2]) / scale
        apart = math.sqrt(max(nmpc.d_agent_safety**2 - over**2, 0.0))
        v = track.v + yielding(own, track, apart, self._config.reciprocity)
        ahead = track.p + track.v * self._config.timing.delay
        sigmas = doubt(own, track, nmpc.d_agent_safety, scale)
        return Neighbour(ahead, v, sigmas, float(company))

    def _judge(self, out: TickOutputs) -> Verdict:
        """The guard's word on what this tick knows."""
        outside, outward = (
            (-np.inf, 0.0) if out.own is None else self._config.fence.across(out.own.p, out.own.v)
        )
        return self._guard.judge(
            Situation(
                out.time,
                out.result,
                out.own,
                age=self._own.age(out.time),
                believable=self._own.believable(out.time),
                outside=outside,
                outward=outward,
                blind=self._eye.blind(out.time),
                held=self._held,
                lost=self._watch.lost,
            )
        )

    def _stream(self, out: TickOutputs) -> None:
        """The guarded command as a setpoint; remembered as the input in flight."""
        verdict = out.verdict = out.verdict or self._judge(out)
        if verdict.ask is Ask.SILENCE:
            return
        command = verdict.command
        thrust = self._lift.map.to_thrust(command.c)
        out.messages.append(
            RateSetpoint(out.time, command.omega, thrust, self._config.link.system_id)
        )
        self._lift.sent(out.time, thrust)
        self._forecast.sent(out.time, np.array([command.c, *command.omega]))

    def _timed(self, out: TickOutputs, stage: str, run: Callable[..., None], *args: object) -> None:
        """Run a stage and note how long it took, by the stop-watch passed in."""
        start = self._stopwatch()
        run(*args)
        out.stages[stage] = self._stopwatch() - start
