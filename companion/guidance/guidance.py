"""Guidance: where to fly, how fast, where to look – and why – as one record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from companion.estimation.delay import Delay
from companion.estimation.height import Height
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.surface_map import SurfaceConfig
from companion.guidance.commissioning import Commissioning
from companion.guidance.corridor import corridor_planes, free_heading
from companion.guidance.detour import Detour
from companion.guidance.fence import FenceConfig
from companion.guidance.gaze import (
    GazeConfig,
    bearing,
    coming_bearing,
    make_gaze,
    nearest_bearing,
)
from companion.guidance.goals import Goal, resolved
from companion.guidance.landing import Landing
from companion.guidance.mission import Mission, MissionConfig, MissionProgress
from companion.guidance.opening import OpeningFinder
from companion.guidance.right_of_way import RightOfWayConfig, blocks_way, pass_on_right
from companion.guidance.speed_limits import (
    SpeedLimitConfig,
    clear_speed,
    headway_speed,
    reaction_speed,
    relative_speed_limit,
    surprised_speed,
    visibility_speed,
)
from companion.guidance.strangers import Strangers
from companion.guidance.threat import ThreatConfig, rated_neighbours
from companion.model import yaw_of
from companion.perception.camera_health import CameraFault
from companion.types import Obstacles, Phase, Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import HomePosition, VehicleState

_AT_ONCE = Delay(0.0, 0.0)
_NO_OFFSET = np.zeros(3)


@dataclass(frozen=True)
class GuidanceSettings:
    """The parts of a drone's configuration that guide it.

    cruise, v_max, blind_speed: m/s; blind_speed is the limit while the camera has a fault. d_ref:
    m, of (9). d_agent, d_obstacle: m, safety distances of (37) and (38).
    """

    mission: MissionConfig
    gaze: GazeConfig
    threat: ThreatConfig
    right_of_way: RightOfWayConfig
    speed_limits: SpeedLimitConfig
    surfaces: SurfaceConfig
    fence: FenceConfig
    cruise: float
    v_max: float
    blind_speed: float
    d_ref: float
    d_agent: float
    d_obstacle: float


@dataclass(frozen=True)
class Reference:
    """What guidance decided at one tick; places (3,) m in the drone's own ENU frame.

    progress: the mission's goal. aim: where to fly to get round obstacles. target: the aim, turned
    to pass a neighbour on the right: what the solver gets. route: the names of the rules that moved
    the target off the goal, in order. yaw: line of sight [rad]. speed: cruise speed
    [m/s]; speed_limit: the name of the limit that it obeys. v_max: bound of (32) [m/s]. near: the
    neighbours in range with their threat, worst first; critical: the first few of them. cohesive:
    ids of the critical ones that fly the same way. obstacles: what stands around. land: whether the
    mission is complete and the drone may come down. map_offset: (3,) m, place on the map, where
    goals and fence are, less that of the own state. floor: m, the lowest z of a plan.
    inhibit_reason: why these goals cannot be flown to; empty: they can. alone: others started
    within sight, and none of them has been seen yet. strangers: ids of neighbours that give no way.
    """

    progress: MissionProgress
    aim: Vector
    target: Vector
    route: tuple[str, ...]
    yaw: float
    speed: float
    speed_limit: str
    v_max: float
    near: list[tuple[Track, float]]
    critical: list[tuple[Track, float]]
    cohesive: frozenset[int]
    obstacles: Obstacles
    land: bool
    map_offset: Vector = field(default_factory=lambda: _NO_OFFSET)
    floor: float = -np.inf
    inhibit_reason: str = ""
    alone: bool = False
    strangers: frozenset[int] = frozenset()


class Guidance:
    """Decides the reference of each tick."""

    def __init__(self, settings: GuidanceSettings) -> None:
        self._settings = settings
        self._commissioning = Commissioning() if settings.mission.commission else None
        # Whether goals of the configuration wait for the vehicle's home, or move with it.
        self._by_home = not all(g.on_map for g in settings.mission.goals)
        self._home: HomePosition | None = None
        self._take_goals(None)
        self.reset()

    def reset(self) -> None:
        """Forget what is tied to the vehicle's clock and place; the mission goes on."""
        s = self._settings
        self._detour = Detour(s.fence.sides())
        self._gaze = make_gaze(s.gaze)
        self._strangers = Strangers(s.speed_limits, s.cruise)
        self._landing = Landing(s.mission, s.d_agent, turns=s.gaze.survey > 0.0)
        self._alone = s.mission.others and self._commissioning is None

    def set_goals(self, goals: Sequence[Vector]) -> None:
        """Fly to these goals (3,) m from now on, the first of them first.

        Not in a commissioning flight: it does not look where it flies.
        """
        if self._commissioning is not None:
            return
        self._by_home, self._inhibit_reason = False, ""
        self._begin([Goal(g) for g in goals])

    def _take_goals(self, home: HomePosition | None) -> None:
        """Take the configured goals, those that are told from `home` too."""
        s = self._settings
        self._home, self._inhibit_reason = home, ""
        goals = resolved(s.mission.goals, home)
        if goals is None:
            self._inhibit_reason = "mission.goals: the vehicle has not told its home position yet"
        for n, goal in enumerate(goals or []):
            beyond, _ = s.fence.across(goal.p, np.zeros(3))
            if beyond > 0.0:
                self._inhibit_reason = f"mission.goals.{n} is {beyond:.1f} m outside the fence"
        self._begin(goals or [])

    def _begin(self, goals: Sequence[Goal]) -> None:
        """Set out to the first of `goals`."""
        s = self._settings
        self._mission, self._opening = Mission(s.mission, goals), OpeningFinder()
        self._landing = Landing(s.mission, s.d_agent, turns=s.gaze.survey > 0.0)

    def decide(
        self,
        own: VehicleState | None,
        tracks: Sequence[Track],
        known: KnownObstacles,
        fault: CameraFault,
        phase: Phase,
        map_offset: Vector = _NO_OFFSET,
        delay: Delay = _AT_ONCE,
        height: Height | None = None,
        home: HomePosition | None = None,
        surprises: int = 0,
        steady: bool = True,
        clear_share: float = 1.0,
    ) -> Reference | None:
        """Return the reference for the own state now; None where that is not known.

        phase: of the tick before. Without control of the vehicle the reference is to stay.
        map_offset: (3,) m, place on the map, where the goals are, less that of the own state.
        delay: from a command to its effect. height: over ground; None: the own frame's zero is it.
        home: of the vehicle, from which goals may be told; None: not known. surprises: neighbours
        that came up close by, in plain view, in the last 20 s. steady: whether the eyes show the
        same neighbours in picture after picture. clear_share: 0…1, of their finds lately.
        """
        if own is None:
            return None
        if self._by_home and home is not self._home and not phase.on_mission:
            self._take_goals(home)
        s = self._settings
        mine = phase.on_mission
        # Not before the turn is over: while all climb side by side poor eyes see some others, too.
        if self._gaze.surveyed:
            self._alone &= not (tracks and steady)
        floor = s.fence.floor(height)
        progress = MissionProgress(own.p, 0, False)
        if mine:
            drift = 0.0 if height is None else height.drift
            progress = self._progress(own, map_offset - [0.0, 0.0, drift], floor, known)
        aim, route = self._route(own, progress.goal, map_offset, known)
        to_aim = aim - own.p
        near = rated_neighbours(own, tracks, s.d_ref, s.threat)
        critical = near[: s.threat.critical]
        strangers: frozenset[int] = frozenset()
        if mine:
            strangers = self._strangers.update(own.time, own.p, own.v, tracks)
        yaw = self._look(own, tracks, critical, to_aim, mine, strangers)
        reaction = reaction_speed(s.speed_limits, delay)
        v_max = s.v_max * min(1.0, reaction / s.cruise)
        speed, limit = self._speed(own, tracks, to_aim, fault, reaction, surprises, clear_share)
        target = pass_on_right(own, tracks, known.cylinders, aim, s.right_of_way)
        if target.tolist() != aim.tolist():
            route = (*route, "right of way")
        planes = corridor_planes(own.p, aim, known.points, s.surfaces)
        return Reference(
            progress=progress,
            aim=aim,
            target=target,
            route=route,
            yaw=yaw,
            speed=speed,
            speed_limit=limit,
            v_max=relative_speed_limit(own, tracks, speed, v_max, s.speed_limits),
            near=near,
            critical=critical,
            # Cohesion is with the critical neighbours that fly the same way: at its distance no
            # drone gets past one that stands in the way.
            cohesive=frozenset(
                t.id for t, _ in critical if not blocks_way(own, t, aim, s.right_of_way)
            ),
            map_offset=map_offset,
            floor=floor,
            inhibit_reason=self._inhibit_reason,
            obstacles=Obstacles(known.cylinders, planes, known.points, known.sigmas),
            land=self._land(own, tracks, progress.complete and phase.flying),
            alone=self._alone,
            strangers=strangers,
        )

    @property
    def _surveyed(self) -> bool:
        """Return whether the drone has looked round, and has seen one of the others if it must."""
        return bool(self._gaze.surveyed) and not self._alone

    def _progress(
        self, own: VehicleState, map_offset: Vector, floor: float, known: KnownObstacles
    ) -> MissionProgress:
        """Return the mission's progress; its goals are on the map, the one returned is not.

        map_offset: with it the own place is on the map, at its height less what that is wrong by.
        known: among its points an opening is looked for; its trunks may stand at goals.
        """
        on_map = replace(own, p=own.p + map_offset)
        if self._commissioning is not None:
            progress = self._commissioning.update(on_map, self._gaze.surveyed)
            return replace(progress, goal=progress.goal - map_offset)
        if (opening := self._mission.opening(on_map.p)) is not None:
            goal, way = opening
            at = goal - map_offset
            self._mission.shift = self._opening.update(own.p, at, way, known.points)
        keep_out = known.cylinders + np.array([*map_offset[:2], self._settings.d_obstacle])
        progress = self._mission.update(
            on_map, self._surveyed, floor + float(map_offset[2]), keep_out
        )
        return replace(progress, goal=progress.goal - map_offset)

    def _route(
        self, own: VehicleState, goal: Vector, map_offset: Vector, known: KnownObstacles
    ) -> tuple[Vector, tuple[str, ...]]:
        """Return the place to aim at (3,) m on the way to the goal, and the rules that moved it.

        From outside the fence the way leads back, wherever the goal is.
        """
        s = self._settings
        back = s.fence.back(own.p + map_offset, goal + map_offset, s.d_obstacle)
        within = goal + back
        around = self._detour.aim(own.p, within, known.cylinders, s.d_obstacle)
        clearance = s.d_obstacle - s.surfaces.rough
        aim = free_heading(own.p, around, known.points, clearance, s.surfaces.range)
        moved = {
            "fence": back.any(),
            "detour": around is not within,
            "walls": aim is not around,
        }
        return aim, tuple(name for name, used in moved.items() if used)

    def _look(
        self,
        own: VehicleState,
        tracks: Sequence[Track],
        critical: Sequence[tuple[Track, float]],
        to_aim: Vector,
        mine: bool,
        strangers: frozenset[int],
    ) -> float:
        """Return the line of sight ψ [rad]."""
        yaw_now = yaw_of(own.q_wb)
        if not mine:
            return self._gaze.follow(own.time, yaw_now)
        if self._commissioning is not None:
            return self._commissioning.yaw(own.time)
        if self._alone and self._gaze.surveyed:
            self._gaze.look_round()
        lost = [bearing(own.p, t) for t, _ in critical if t.lost]
        close = nearest_bearing(own.p, own.v, tracks, self._settings.gaze)
        coming = coming_bearing(own.p, own.v, tracks, self._settings.gaze, strangers)
        return self._gaze.update(
            own.time, own.v, to_aim, yaw_now, lost, close, coming, bool(strangers)
        )

    def _speed(
        self,
        own: VehicleState,
        tracks: Sequence[Track],
        to_aim: Vector,
        fault: CameraFault,
        reaction: float,
        surprises: int,
        clear_share: float,
    ) -> tuple[float, str]:
        """Return the cruise speed [m/s] and the name of the limit that it obeys.

        reaction: m/s, the limit by the delay. surprises: neighbours that came up close by lately.
        clear_share: 0…1, of the finds lately.
        """
        s = self._settings
        visible = visibility_speed(s.speed_limits, yaw_of(own.q_wb), to_aim)
        limits = {
            "cruise": s.cruise,
            "visibility": s.cruise * (visible if self._commissioning is None else 1.0),
            "headway": headway_speed(
                own, tracks, to_aim, s.cruise, s.speed_limits, s.right_of_way, s.threat.range_max
            ),
            "surprises": surprised_speed(s.speed_limits, surprises, s.cruise, s.blind_speed),
            "clear finds": clear_speed(s.speed_limits, clear_share, s.cruise, s.blind_speed),
            "reaction": reaction,
        }
        if fault is not CameraFault.NONE:
            limits["camera"] = s.blind_speed
        name = min(limits, key=lambda n: limits[n])
        return limits[name], name

    def _land(self, own: VehicleState, tracks: Sequence[Track], complete: bool) -> bool:
        """Return whether to land, at the end of the mission."""
        if not complete:
            return False
        step = self._landing.update(own, tracks, self._gaze.surveyed)
        if step.look_round:
            self._gaze.look_round()
        return step.land
