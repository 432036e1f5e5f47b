"""Monitors: does what the flight assumes still hold?

Each monitor watches one assumption and says what the drone does where it does not hold:

| monitor | evidence | slow | HOLD |
|---|---|---|---|
| speed | faster than `speed_over` × v_max | at once | after `persist` |
| swing | roll or pitch rate to and fro by `swing_rate`, `swings` times | at once | in hover |
| model | mean disturbance (drag, wind, thrust) above `disturbance` | at once | after `persist` |
| delay | from a tick to its effect, longer than `delay_slow`, `delay_hold` | at once | at once |
| gyro | attitude turns otherwise than the gyro tells, by `turn` in 1 s | – | at once |
| place | position steps or slides by more than `slide` within 3 s | meanwhile | – |
| doubt | the autopilot rejects a sensor | meanwhile | – |
| doubt | velocity less sure than `velocity_doubt` | at once | after `persist` |
| sight | the ground in the pictures passes otherwise, by `velocity_wrong` | after `persist` | – |
| heading | the ground in the pictures passes from another side, by `heading_wrong` | at once | – |
| eyes | no trunk is seen, where one known for good is in plain view | at once | after `persist` |
| eyes | `surprises` neighbours have come up close by, in plain view, within 20 s | – | at once |
| map | `upsets` trunks known for good have moved or vanished within 20 s | from half on | at once |
| others | none seen steadily yet, though `mission.others` | after a turn | after `alone` |
| height | less than `height` over ground | climbs | after 2 × `persist` |

A drone that swings hovers after `persist`; HOLD follows where it swings in hover for as long.

A camera that does not fit (`camera_alignment.py`) is a camera fault, a clock that jumps, stale
telemetry and a state that cannot be are the guard's first rules.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np
from pydantic import Field

from companion.estimation.delay import Delay
from companion.estimation.motion import MotionEstimate
from companion.estimation.turns import Turn
from companion.estimation.vehicle import VehicleEstimate
from companion.supervision.guard import Broken, Reaction
from companion.types import Phase
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

_SWING_TIME = 3.0  # s in which the swings are counted
_SPREADS = 2.0  # of what sparse samples leave open of a turn
_TURN_TIME = 1.0  # s over which gyro and attitude are compared
_SLIDE_TIME = 3.0  # s over which the offset of the map is compared
_LONGEST_GAP = 0.25  # s between two ticks, over which rates are not summed up
_MEAN_TIME = 2.0  # s over which the disturbance is averaged: gusts and noise pass
_LOOK_ROUND = 4.0  # s that the first look round takes
_SURE = 2.0  # standard deviations of an estimated heading
_HEIGHT_SURE = 0.3  # m; a height less sure than this says nothing


class MonitorConfig(StrictModel):
    """Bounds of what is taken for granted."""

    speed_over: float = Field(1.5, gt=1, description="Speed over v_max that is too fast.")
    swing_rate: float = Field(1.5, gt=0, description="Roll or pitch rate [rad/s] of a swing.")
    swings: int = Field(8, ge=4, description="Swings to and fro within 3 s that are too many.")
    disturbance: float = Field(
        4.0, gt=0, description="Acceleration [m/s²] that the model knows nothing of."
    )
    delay_slow: float = Field(
        0.35, gt=0, description="Delay [s] from a tick to its effect from which to fly slowly."
    )
    delay_hold: float = Field(
        0.5, gt=0, description="Delay [s] from a tick to its effect from which HOLD is requested."
    )
    turn: float = Field(
        0.35, gt=0, description="Angle [rad] between gyro and attitude after a second of turning."
    )
    slide: float = Field(
        1.0, gt=0, description="Way [m] of the position in 3 s that the velocity does not show."
    )
    velocity_doubt: float = Field(
        0.5, gt=0, description="1 σ [m/s] of the velocity above which it is no use."
    )
    velocity_wrong: float = Field(
        1.0,
        gt=0,
        description="Error of the reported velocity [m/s], by the ground in the pictures, from "
        "which to fly slowly: the velocity is corrected, but goals and fence move with it.",
    )
    heading_wrong: float = Field(
        0.6,
        gt=0,
        description="Error of the heading [rad], by the ground in the pictures and beyond doubt, "
        "from which to fly slowly. Up to there the velocity is corrected and goals are found: a "
        "swarm in which all slow down because of 20° swings, and ends in HOLD.",
    )
    surprises: int = Field(
        6,
        gt=1,
        description="Neighbours that come up close by, in plain view, within 20 s, from which the "
        "eyes show too much that is not there, or too little: HOLD. Fewer slow the drone down, see "
        "`speed_limits.surprises`.",
    )
    upsets: int = Field(
        10,
        gt=1,
        description="Trunks known for good that moved or vanished within 20 s, from which the map "
        "of trunks is wrong: HOLD. From half as many on the drone flies slowly.",
    )
    alone: float = Field(
        15.0,
        gt=0,
        description="Time [s] of looking round after which one of the others must have been seen "
        "steadily, where `mission.others` says that there are any: four turns.",
    )
    height: float = Field(0.5, ge=0, description="Least height [m] over ground.")
    persist: float = Field(
        1.5, gt=0, description="Time [s] after which a broken assumption asks for HOLD."
    )


class Monitors:
    """Watches the assumptions of the flight, tick by tick."""

    def __init__(self, config: MonitorConfig, v_max: float) -> None:
        """v_max: m/s, highest speed of a plan."""
        self._config = config
        self._v_max = v_max
        self.reset()

    def reset(self) -> None:
        """Forget the past: another flight begins."""
        self._since: dict[str, float] = {}
        self._time = -math.inf
        self._swings: tuple[deque[float], deque[float]] = (deque(), deque())
        self._sides = [0, 0]
        self._turns: deque[Turn] = deque()
        self._offsets: deque[tuple[float, Vector]] = deque()
        self._disturbance: Vector = np.zeros(3)

    def update(
        self,
        time: float,
        vehicle: VehicleEstimate,
        motion: MotionEstimate,
        phase: Phase,
        blank: bool = False,
        alone: bool = False,
        surprises: int = 0,
        upsets: int = 0,
    ) -> Broken | None:
        """Return the gravest broken assumption at the tick of `time` [s]; None: all hold.

        blank: the eyes show no trunk where one is known. alone: none of the others has been seen
        steadily yet. surprises: neighbours that came up close by, in plain view, in the last 20 s.
        upsets: trunks known for good that moved or vanished in the last 20 s.
        Nothing is watched where the companion does not fly its mission.
        """
        own, prediction = vehicle.state, motion.prediction
        if phase is not Phase.FLY:
            self.reset()
        if phase is not Phase.FLY or own is None:
            return None
        found = [
            self._fast(time, own),
            self._model(time, None if prediction is None else prediction.disturbance),
            self._late(motion.delay),
            self._doubt(time, vehicle),
            self._contradicted(time, vehicle),
            self._turned(vehicle),
            self._blank(time, blank),
            self._unmet(time, alone),
            self._surprised(surprises),
            self._upset(upsets),
            self._low(time, vehicle),
            self._swinging(time, own),
            self._turning(vehicle.turns),
            self._sliding(time, vehicle.slid),
        ]
        self._time = time
        return max((b for b in found if b is not None), key=lambda b: b.reaction, default=None)

    def _lasting(self, name: str, time: float, finding: str, *, hold_after: float) -> Broken:
        since = self._since.setdefault(name, time)
        lasts = time - since >= hold_after - 1e-6
        return Broken(finding, Reaction.HOLD if lasts else Reaction.SLOW)

    def _fast(self, time: float, own: VehicleState) -> Broken | None:
        c, speed = self._config, norm(own.v)
        if not speed > c.speed_over * self._v_max:
            self._since.pop("speed", None)
            return None
        finding = f"speed: {speed:.1f} m/s, v_max is {self._v_max:g}"
        return self._lasting("speed", time, finding, hold_after=c.persist)

    def _model(self, time: float, disturbance: Vector | None) -> Broken | None:
        c = self._config
        dt = min(max(time - self._time, 0.0), _LONGEST_GAP)  # s
        now = np.zeros(3) if disturbance is None else disturbance
        self._disturbance = self._disturbance + dt / _MEAN_TIME * (now - self._disturbance)
        size = norm(self._disturbance)
        if not size > c.disturbance:
            self._since.pop("model", None)
            return None
        finding = f"model: {size:.1f} m/s² of acceleration are not explained"
        return self._lasting("model", time, finding, hold_after=c.persist)

    def _late(self, delay: Delay) -> Broken | None:
        c = self._config
        if not delay.value > c.delay_slow:
            return None
        reaction = Reaction.HOLD if delay.value > c.delay_hold else Reaction.SLOW
        return Broken(f"delay: {delay.value:.2f} s from a tick to its effect", reaction)

    def _doubt(self, time: float, vehicle: VehicleEstimate) -> Broken | None:
        c, doubt = self._config, vehicle.doubt
        finding = ""
        if doubt.velocity > c.velocity_doubt:
            finding = f"doubt: the velocity is sure to {doubt.velocity:.1f} m/s"
        if not finding:
            self._since.pop("doubt", None)
            if doubt.rejects:
                return Broken("doubt: the autopilot rejects one of its sensors", Reaction.SLOW)
            return None
        return self._lasting("doubt", time, finding, hold_after=c.persist)

    def _contradicted(self, time: float, vehicle: VehicleEstimate) -> Broken | None:
        """Never HOLD: the autopilot would hold by the velocity that is wrong."""
        wrong = norm(vehicle.by_sight.error)
        if not wrong > self._config.velocity_wrong:
            self._since.pop("sight", None)
            return None
        if time - self._since.setdefault("sight", time) < self._config.persist - 1e-6:
            return None
        return Broken(f"sight: the velocity is wrong by {wrong:.1f} m/s", Reaction.SLOW)

    def _turned(self, vehicle: VehicleEstimate) -> Broken | None:
        """Never HOLD: with a heading that is wrong the autopilot circles round the place."""
        turn, sigma = vehicle.by_sight.turn, vehicle.by_sight.turn_sigma
        if not abs(turn) - _SURE * sigma > self._config.heading_wrong:
            return None
        return Broken(f"heading: wrong by {math.degrees(turn):.0f}°", Reaction.SLOW)

    def _blank(self, time: float, blank: bool) -> Broken | None:
        if not blank:
            self._since.pop("eyes", None)
            return None
        finding = "eyes: no trunk is seen where one is known"
        return self._lasting("eyes", time, finding, hold_after=self._config.persist)

    def _unmet(self, time: float, alone: bool) -> Broken | None:
        if not alone:
            self._since.pop("others", None)
            return None
        if time - self._since.setdefault("others", time) < _LOOK_ROUND:
            return None
        finding = "others: none has been seen steadily, and some started within sight"
        return self._lasting("others", time, finding, hold_after=self._config.alone)

    def _surprised(self, surprises: int) -> Broken | None:
        if surprises < self._config.surprises:
            return None
        finding = f"eyes: {surprises} neighbours have come up close by, in plain view"
        return Broken(finding, Reaction.HOLD)

    def _upset(self, upsets: int) -> Broken | None:
        if 2 * upsets < self._config.upsets:
            return None
        finding = f"map: {upsets} known trunks have moved or vanished"
        return Broken(finding, Reaction.HOLD if upsets >= self._config.upsets else Reaction.SLOW)

    def _low(self, time: float, vehicle: VehicleEstimate) -> Broken | None:
        c, height = self._config, vehicle.height
        if height is None or height.sigma > _HEIGHT_SURE or not height.value < c.height:
            self._since.pop("height", None)
            return None
        finding = f"height: {height.value:.2f} m over ground"
        lasting = self._lasting("height", time, finding, hold_after=2.0 * c.persist)
        return Broken(finding, max(lasting.reaction, Reaction.CLIMB))

    def _swinging(self, time: float, own: VehicleState) -> Broken | None:
        """Count how often roll and pitch rate go from one side to the other.

        A plan among many neighbours swings, too: in hover no plan is flown, and that ends. A rate
        loop that is not stable goes on swinging.
        """
        c, most, lately = self._config, 0, 0
        for axis, swings in enumerate(self._swings):
            rate = float(own.omega[axis])
            side = 0 if abs(rate) < c.swing_rate else int(math.copysign(1, rate))
            if side and side == -self._sides[axis]:
                swings.append(time)
            self._sides[axis] = side or self._sides[axis]
            while swings and time - swings[0] > _SWING_TIME:
                swings.popleft()
            most = max(most, len(swings))
            lately = max(lately, sum(time - swing <= c.persist for swing in swings))
        if most < c.swings:
            self._since.pop("swing", None)
            return None
        finding = f"swing: {most} times to and fro in {_SWING_TIME:g} s"
        lasts = time - self._since.setdefault("swing", time) + 1e-6
        if lasts < c.persist:
            return Broken(finding, Reaction.SLOW)
        still = lasts >= 2.0 * c.persist and lately >= c.swings * c.persist / _SWING_TIME
        return Broken(finding, Reaction.HOLD if still else Reaction.HOVER)

    def _turning(self, turns: Iterable[Turn]) -> Broken | None:
        """Compare the attitude's turn with the sum of the rates, over a second of telemetry."""
        c = self._config
        for turn in turns:
            if not turn.follows:
                self._turns.clear()
            self._turns.append(turn)
            while turn.time - self._turns[0].time > _TURN_TIME:
                self._turns.popleft()
        if not self._turns:
            return None
        axes = zip(*(turn.off for turn in self._turns), strict=True)
        size = math.hypot(*(sum(axis) for axis in axes))
        # When the rate changed between two samples is not known.
        between = math.sqrt(sum(turn.spread**2 for turn in self._turns))
        if not size > c.turn + _SPREADS * between:
            return None
        finding = f"gyro: attitude and gyro differ by {math.degrees(size):.0f}° in a second"
        return Broken(finding, Reaction.HOLD)

    def _sliding(self, time: float, slid: Vector) -> Broken | None:
        self._offsets.append((time, slid))
        while time - self._offsets[0][0] > _SLIDE_TIME:
            self._offsets.popleft()
        way = norm(slid - self._offsets[0][1])
        if not way > self._config.slide:
            return None
        finding = f"place: the position went {way:.1f} m that the velocity does not show"
        return Broken(finding, Reaction.SLOW)
