"""Line of sight: the direction of motion plus a random sweep, eq. (7).

L = atan2(v_y, v_x) + ε, ε ~ N(μ, σ²). A fresh ε every tick would only shake the drone: each
half-swing draws its amplitude from the distribution, and half-swings alternate sides. The reference
is slew-limited, as the drone can turn only so fast. Before it sets out, a drone looks once all
round: two drones that start abeam of each other are both beyond the edge of the other's view. Where
some give no way, it does so again and again while it is slow: what is faster comes from all sides.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.parts import PartKind
from mavlink_bridge.shared.settings import StrictModel

_RIM = 0.2  # rad beyond `half_view` that the picture still shows, though badly
# s: a drone turned 0.25 s later than its reference (crossing 99861, pixels), which holds for 0.1.
_TURNING = 0.35
_BODIES = 0.4  # m between the centres of two drones that touch
_BACK = 0.6  # of `half_view`: so far off the line of sight one is that a look back is for


GAZES = PartKind(
    "gaze",
    "swarm_companion.gazes",
    {"sweep": "companion.guidance.gaze:Gaze"},
    (frozenset({"look_round", "update", "follow"}),),
)


class GazeConfig(StrictModel):
    """The sweep of eq. (7), or a gaze of the user."""

    kind: Annotated[str, AfterValidator(GAZES.check)] = Field(
        "sweep",
        description="sweep: eq. (7); your own by the name of its entry point, or module:Class.",
    )
    options: dict[str, Any] = Field({}, description="For your own gaze, which reads them.")
    mean: float = Field(0.0, description="μ [rad].")
    sigma: float = Field(0.6, ge=0, description="σ [rad]; 0, where μ is 0, switches the sweep off.")
    limit: float = Field(
        0.8,
        gt=0,
        description="Most |ε| [rad]: the way ahead stays inside ±80° of view. For a "
        "neighbour that is `close` up to `half_view`, where that shows it.",
    )
    half_view: float = Field(
        1.2, gt=0, description="A neighbour this far [rad] off the line of sight is in view."
    )
    close: float = Field(
        1.0,
        ge=0,
        description="The neighbour that comes nearest within a swing stays in view, if nearer than "
        "this [m].",
    )
    comes_within: float = Field(
        3.0,
        ge=0,
        description="A neighbour that may hit within this time [s], and is out of sight or gives "
        "no way, is looked at, however far behind it is: the drone turns from its way, and is "
        "slow meanwhile. So is one out of sight that may be here already. 0: nobody is.",
    )
    strangers: bool = Field(
        False,
        description="Whether drones that give no way are expected: then a slow drone looks all "
        "round from the beginning, else for 20 s after it has met one.",
    )
    round_below: float = Field(
        0.5,
        ge=0,
        description="Where some give no way, a drone slower than this [m/s] looks all round, "
        "unless one that comes is in view: more may come from behind. 0: it does not.",
    )
    round_every: float = Field(
        4.0,
        ge=0,
        description="So long [s] after it last looked all round; as long as a neighbour out of "
        "view is remembered.",
    )
    half_period: float = Field(0.9, gt=0, description="Time [s] of one swing to one side.")
    slew: float = Field(2.0, gt=0, description="Fastest turn of the reference [rad/s].")
    speed_min: float = Field(
        0.3,
        ge=0,
        description="Below this [m/s] atan2 says nothing: the sweep keeps its last direction.",
    )
    goal_pull: float = Field(
        1.5, ge=0, description="Weight [m/s] of the direction to the goal beside the velocity."
    )
    goal_near: float = Field(
        0.5, gt=0, description="Nearer than this [m] to the goal, its direction is ignored."
    )
    survey: float = Field(
        2 * math.pi, ge=0, description="Turn [rad] on the spot before setting out; 0: none."
    )
    seed: int = Field(0, ge=0, description="Seed of the random sweep; each drone has its own.")


class Gaze:
    """Decides the yaw reference ψ(t) in the drone's own ENU frame."""

    def __init__(self, config: GazeConfig) -> None:
        self._config = config
        self._rng = np.random.default_rng(config.seed)
        self._side = 1.0 if self._rng.random() < 0.5 else -1.0
        self._swing_ends = -math.inf
        self._epsilon = 0.0
        self._yaw: float | None = None
        self._base = self._time = 0.0
        self._to_survey, self._to_turn, self._looked_round = config.survey, 0.0, -math.inf
        self._for_comer = False

    @property
    def surveyed(self) -> bool:
        """Whether the last look round, before setting out or by `look_round`, is over."""
        return self._to_survey <= 0.0

    def look_round(self) -> None:
        """Turn once all round on the spot, from now on."""
        self._to_survey = self._config.survey

    def update(
        self,
        time: float,
        v: Vector,
        to_goal: Vector,
        yaw_now: float,
        lost: Sequence[float] = (),
        close: float | None = None,
        coming: float | None = None,
        strangers: bool = False,
    ) -> float:
        """Return ψ [rad] at `time` [s] for velocity v (3,) and direction to the goal (3,).

        Until `surveyed`, the drone turns on the spot. Then the sweep is about the direction of the
        motion to come: v plus a pull to the goal, so that a drone that must turn round looks before
        it flies. Over the goal itself the direction stays as it was.

        lost: world bearings [rad] of near neighbours that are out of view, most threatening first.
        The next swing goes to the first of them that a swing within `limit` brings into view.
        close: world bearing [rad] of the nearest neighbour where it comes nearer than the setting
        `close`: no swing loses sight of it, or of the way ahead, but to show one that comes.
        coming: world bearing [rad] of that, see `coming_bearing`: a swing that does not show it
        ends, and the next one does, even away from the way ahead. strangers: whether some give no
        way: then a slow drone turns all round now and then.
        """
        c = self._config
        if self._yaw is None:
            self._yaw, self._base, self._time = yaw_now, yaw_now, time
            self._looked_round = time
        step = c.slew * max(time - self._time, 0.0)
        self._turn_to(coming)
        if not self.surveyed or self._to_turn > 0.0:
            self._to_survey -= step
            self._to_turn -= step
            self._looked_round = time
            return self._turned(self._side * step, time)
        if (strangers or c.strangers) and norm(v) < c.round_below:
            self._look_round_again(time, coming)
        self._follow_motion(v, to_goal)
        base = self._base
        comer = None if coming is None else wrap(coming - base)
        missed = comer is not None and abs(wrap(comer - self._epsilon)) > c.half_view
        if time >= self._swing_ends or (missed and not self._for_comer):
            self._swing_ends, self._for_comer = time + c.half_period, comer is not None
            self._epsilon = self._swing([wrap(bearing - base) for bearing in lost], comer)
        epsilon = self._epsilon
        if close is not None and abs(epsilon) <= c.limit:
            off = wrap(close - base)
            # Both it and the way ahead are in view, by a wider swing where that is needed.
            least, most = max(off, 0.0) - c.half_view, min(off, 0.0) + c.half_view
            held = min(max(epsilon, least), most)
            if least <= most and (not self._shows(comer, epsilon) or self._shows(comer, held)):
                epsilon = held
        turn = wrap(base + epsilon - self._yaw)
        return self._turned(min(max(turn, -step), step), time)

    def follow(self, time: float, yaw: float) -> float:
        """Return `yaw` [rad] as ψ while the companion does not turn the drone; start afresh."""
        self._yaw, self._base, self._time = yaw, yaw, time
        self.look_round()
        return yaw

    def _shows(self, off: float | None, epsilon: float) -> bool:
        """Return whether one `off` [rad] the base direction is in view where that is swung by ε."""
        return off is not None and abs(wrap(off - epsilon)) <= self._config.half_view + _RIM

    def _in_view(self, coming: float | None) -> bool:
        """Return whether one that comes, if any, is in view where the drone is to look now."""
        assert self._yaw is not None
        return coming is not None and abs(wrap(coming - self._yaw)) <= self._config.half_view

    def _turn_to(self, coming: float | None) -> None:
        """Let a look all round go to the side of one that comes; it ends where that is in view."""
        if coming is None or self._to_turn <= 0.0:
            return
        assert self._yaw is not None
        self._side = math.copysign(1.0, wrap(coming - self._yaw))
        if self._in_view(coming):
            self._to_turn = 0.0

    def _look_round_again(self, time: float, coming: float | None) -> None:
        """Begin a turn all round where the last one is long ago, and none that comes is in view."""
        long_ago = time - self._looked_round >= self._config.round_every
        if long_ago and not self._in_view(coming):
            self._to_turn, self._side = 2.0 * math.pi, -self._side

    def _follow_motion(self, v: Vector, to_goal: Vector) -> None:
        """Set the direction about which the sweep swings."""
        c = self._config
        far = math.hypot(to_goal[0], to_goal[1])
        pull = c.goal_pull / far if far > c.goal_near else 0.0
        motion = (v[0] + pull * to_goal[0], v[1] + pull * to_goal[1])
        if math.hypot(*motion) >= c.speed_min:
            self._base = math.atan2(motion[1], motion[0])

    def _turned(self, by: float, time: float) -> float:
        """Turn ψ by `by` [rad] since the last tick; return it."""
        assert self._yaw is not None
        self._yaw, self._time = wrap(self._yaw + by), time
        return self._yaw

    def _swing(self, lost: Sequence[float], coming: float | None) -> float:
        """Return ε [rad] of the next half-swing; lost, coming: bearings off the base direction."""
        c = self._config
        if coming is not None and abs(coming) > c.half_view - c.limit:
            lost = [coming, *lost]
        lost = [off for off in lost if abs(off) < c.half_view + _RIM + c.limit]
        amplitude = c.mean + abs(float(self._rng.normal(0.0, c.sigma)))
        self._side = -self._side
        if lost and c.sigma > 0.0:
            self._side = math.copysign(1.0, lost[0])
            amplitude = max(amplitude, abs(lost[0]) - c.half_view)
        if coming is not None and c.sigma > 0.0 and abs(coming) >= c.half_view + c.limit - _RIM:
            self._side = math.copysign(1.0, coming)
            return self._side * (abs(coming) - _BACK * c.half_view)
        return self._side * min(max(amplitude, -c.limit), c.limit)


def make_gaze(config: GazeConfig) -> Gaze:
    """Return the gaze that `gaze.kind` names; a user's has the members of `Gaze`.

    Raises:
        PartError: a user's gaze that cannot be used.
    """
    made: Gaze = GAZES.load(config.kind)(config)
    return made


def bearing(p: Vector, track: Track) -> float:
    """Return the world bearing [rad] of a neighbour from p (3,) m."""
    return math.atan2(track.p[1] - p[1], track.p[0] - p[0])


def nearest_bearing(
    p: Vector, v: Vector, tracks: Sequence[Track], config: GazeConfig
) -> float | None:
    """Return the bearing [rad] of the neighbour that comes nearest within a swing; None: none near.

    p, v: (3,) m, m/s, the own. Near is nearer than `close` on the present courses. The bearing is
    that at which it will be once the drone has turned: who passes close by leaves the view faster.
    """
    coming = [(nearest_within(t.p - p, t.v - v, config.half_period), t) for t in tracks]
    gap, nearest = min(coming, key=lambda c: c[0], default=(math.inf, None))
    if nearest is None or gap >= config.close:
        return None
    x, y, _ = nearest.p - p + _TURNING * (nearest.v - v)
    return math.atan2(y, x)


def coming_bearing(
    p: Vector,
    v: Vector,
    tracks: Sequence[Track],
    config: GazeConfig,
    strangers: Container[int] = (),
) -> float | None:
    """Return the bearing [rad] of the neighbour to be looked at that may hit first; None: none.

    p, v: (3,) m, m/s, the own. That is one that would be there within `comes_within`, on the
    present courses and if it has come as much nearer than believed as it would since it was seen;
    and that is out of sight, or one of strangers, ids of those that give no way. Where there is
    none it is the nearest out of sight that may be here already, by 1 σ of its place: it is looked
    at before it is forgotten.
    """
    first, nearest = config.comes_within, None
    for t in tracks:
        offset = t.p - p
        apart = norm(offset)
        closing = -float(offset @ (t.v - v)) / max(apart, _BODIES)
        if closing > 0.0 and (t.lost or t.id in strangers):
            left = (apart - _BODIES) / closing - t.unseen
            if left < first:
                first, nearest = left, t
    if nearest is None and config.comes_within > 0.0:
        here = [(norm(t.p - p), t) for t in tracks if t.lost]
        here = [one for one in here if one[0] - _BODIES < math.sqrt(one[1].variances[0])]
        _, nearest = min(here, key=lambda one: one[0], default=(0.0, None))
    return None if nearest is None else bearing(p, nearest)


def nearest_within(offset: Vector, velocity: Vector, time: float) -> float:
    """Return the least length [m] of offset (3,) m within `time` [s], moving at velocity (3,)."""
    closing = -float(offset @ velocity)
    square = float(velocity @ velocity)
    at = min(max(closing / square, 0.0), time) if square > 0.0 else 0.0
    return norm(offset + at * velocity)


def wrap(angle: float) -> float:
    """Return the same angle in (−π, π]."""
    return math.atan2(math.sin(angle), math.cos(angle))
