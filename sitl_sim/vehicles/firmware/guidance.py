"""What each mode asks of the outer loops: one vehicle's row of `Setpoints`.

World frame, the autopilot's estimate, SI; time is the world's, in seconds. Each `_fly_…` flies
one mode at 100 Hz and returns the mode to change to, or None to stay in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.messages import RateSetpoint
from sitl_sim.vehicles.estimator import Estimate
from sitl_sim.vehicles.firmware.flavour import Mode, Settings
from sitl_sim.vehicles.firmware.ids import MissionCommand
from sitl_sim.vehicles.outer_loops import Control, Setpoints

REACHED_HEIGHT = 0.15  # m, a climb ends this close to its altitude
CRAWL_HEIGHT = 0.6  # m, below it a landing is slow
MISSION_HEIGHT = 0.8  # m, a waypoint counts as reached this close in height
_RAMP_LIFTS, _RAMP_ENDS = 1 / 3, 2.0  # of the ramp's time: to lift off, from there to full speed
BRAKE_TIME = 0.5  # s, a vehicle that is to stay comes to rest this much further on


@dataclass(frozen=True)
class Waypoint:
    """A mission item in the world frame: MAV_CMD, p (3,) m, seconds to stay, radius [m].

    speed: m/s, of DO_CHANGE_SPEED; 0 where not given.
    """

    command: int
    p: tuple[float, float, float]
    stay: float = 0.0
    radius: float = 0.0
    speed: float = 0.0


class Guidance:
    """The guidance of vehicle i.

    feet: returns the true height [m] of its feet over the ground. ranges: whether it has a
    rangefinder and so knows that height. origin_z: m, world, of the vehicle's own frame.
    """

    def __init__(
        self,
        i: int,
        settings: Settings,
        sp: Setpoints,
        est: Estimate,
        feet: Callable[[], float],
        ranges: bool = False,
        origin_z: float = 0.0,
    ) -> None:
        self.feet, self._ranges, self._origin_z = feet, ranges, origin_z
        self.i, self.settings, self.sp, self.est = i, settings, sp, est
        self.now = 0.0
        self.landed = True
        self.position_ok = True
        self.home = (0.0, 0.0, 0.0)
        self.mission: list[Waypoint] = []
        self.mission_seq = 0
        self.reached: list[int] = []  # mission items reached and not yet reported
        self.setpoint: RateSetpoint | None = None
        self.setpoint_at = -math.inf
        self.climb_to = math.nan
        self.armed_at = -math.inf
        self._began = -math.inf
        self._from_ground = True
        self._arrived_at = math.nan
        self._fly: dict[Mode, Callable[[], Mode | None]] = {
            Mode.TAKEOFF: self._fly_takeoff,
            Mode.OFFBOARD: self._fly_offboard,
            Mode.LAND: self._fly_land,
            Mode.RETURN: self._fly_return,
            Mode.MISSION: self._fly_mission,
        }

    def begin(self, mode: Mode, before: Mode) -> None:
        """Enter `mode` from the mode `before`."""
        s = self.settings
        self._began = self.now
        self._from_ground = self.landed
        self.climb_to = self._arrived_at = math.nan
        self.sp.limits[self.i] = (s.cruise_speed, s.up_speed, s.down_speed)
        # After a climb keep its target: the vehicle should stay there, not where the climb ended.
        if not (mode is Mode.HOLD and before is Mode.TAKEOFF and not self.landed):
            self.stay()

    def step(self, mode: Mode) -> Mode | None:
        """Update the setpoints; return the mode to change to, if any."""
        fly = self._fly.get(mode)
        if fly is not None:
            return fly()
        self._control(Control.IDLE if self.landed else self._holding)
        return None

    def stop_motors(self) -> None:
        """Stop the motors, as when disarmed."""
        self._control(Control.OFF)

    def stay(self) -> None:
        """Hold the place where the vehicle comes to rest, and its yaw."""
        i = self.i
        self.sp.p[i] = self.est.p[i] + BRAKE_TIME * self.est.v[i]
        self.sp.v[i] = 0.0
        _, _, self.sp.yaw[i] = euler_from_quaternion(self.est.q[i])

    def follow(self, m: RateSetpoint, armed_offboard: bool) -> None:
        """Take a setpoint; fly it at once where the vehicle is armed in offboard."""
        self.setpoint, self.setpoint_at = m, self.now
        if armed_offboard:
            self.climb_to = math.nan
            self._apply(m)

    def stop_following(self) -> None:
        """Forget the setpoints and hold."""
        self.setpoint = None
        self.stay()

    def _apply(self, m: RateSetpoint) -> None:
        i, sp, s = self.i, self.sp, self.settings
        thrust = min(max(m.thrust, 0.0), 1.0)
        sp.omega[i] = m.omega
        sp.omega[i, 2] = min(max(sp.omega[i, 2], -s.yaw_rate_max), s.yaw_rate_max)
        if m.q_wb is not None:
            sp.q[i] = m.q_wb
            sp.v[i] = (0.0, 0.0, m.omega[2])
        if not s.thrust_is_climb:
            sp.thrust[i] = thrust
            self._control(Control.RATES if m.q_wb is None else Control.ATTITUDE)
            return
        # 0.5 holds the height; the ends are full climb and full descent.
        climb = 2.0 * (thrust - 0.5) * (s.up_speed if thrust > 0.5 else s.down_speed)
        sp.v[i] = (0.0, 0.0, climb)
        rests = self.landed and climb <= 0.0
        self._control(Control.IDLE if rests else Control.RATES_AND_CLIMB)

    def _control(self, control: Control) -> None:
        self.sp.control[self.i] = control

    @property
    def _holding(self) -> Control:
        return Control.POSITION if self.position_ok else Control.LEVEL

    def _go(self, x: float, y: float, z: float, vz: float = 0.0) -> None:
        """Fly to a place; z is NaN where a vertical velocity vz is given."""
        i = self.i
        self._control(self._holding)
        self.sp.p[i] = (x, y, z)
        self.sp.v[i] = (0.0, 0.0, vz)

    def _descend(self, x: float, y: float) -> None:
        if self.landed:
            self._control(Control.IDLE)
            return
        s = self.settings
        above = self.feet() if self._ranges else self.est.p[self.i, 2] - self._origin_z
        slow = above < CRAWL_HEIGHT
        self._go(x, y, math.nan, -(s.crawl_speed if slow else s.land_speed))

    def _fly_takeoff(self) -> Mode | None:
        i = self.i
        if math.isnan(self.climb_to):
            self.climb_to = float(self.est.p[i, 2]) + self.settings.takeoff_altitude
        self._climb()
        return Mode.HOLD if self.est.p[i, 2] > self.climb_to - REACHED_HEIGHT else None

    def _climb(self) -> None:
        i = self.i
        self.sp.limits[i, 1] = self._climb_speed()
        if self.sp.limits[i, 1] <= 0.0 and self.landed:
            self._control(Control.IDLE)
        else:
            self._go(self.sp.p[i, 0], self.sp.p[i, 1], self.climb_to)

    def _climb_speed(self) -> float:
        """Return the speed [m/s] that a take-off has now: motors spool up, then thrust ramps up.

        A PX4's thrust begins below hover, so that it lifts off after a third of the ramp; its climb
        then takes two ramps to reach its speed (measured: 2 m up after 5 s).
        """
        s = self.settings
        begin = max(self._began, self.armed_at + s.spool_up)
        if not s.takeoff_ramp or not self._from_ground:
            return s.takeoff_speed if self.now >= begin else 0.0
        share = ((self.now - begin) / s.takeoff_ramp - _RAMP_LIFTS) / _RAMP_ENDS
        return s.takeoff_speed * min(max(share, 0.0), 1.0)

    def _fly_offboard(self) -> Mode | None:
        """Follow the newest setpoint; hold without one, level after a lost one (ArduPilot)."""
        i = self.i
        if not math.isnan(self.climb_to):
            self._climb()
            return None
        if self.setpoint is None or self.now - self.setpoint_at > self.settings.loss_time:
            stale = self.setpoint is not None and self.setpoint_at > self._began
            if stale and self.sp.control[i] != Control.LEVEL:
                self.stay()
            control = Control.LEVEL if stale else self._holding
            self._control(Control.IDLE if self.landed else control)
            return None
        self._apply(self.setpoint)
        return None

    def _fly_land(self) -> Mode | None:
        self._descend(self.sp.p[self.i, 0], self.sp.p[self.i, 1])
        return None

    def _fly_return(self) -> Mode | None:
        i = self.i
        p, (x, y, z) = self.est.p[i], self.home
        away = math.hypot(p[0] - x, p[1] - y)
        if math.isnan(self.climb_to):
            self.climb_to = max(float(p[2]), z + self._return_height(away))
        if self.landed or not math.isnan(self._arrived_at):
            self._descend(x, y)
        elif p[2] < self.climb_to - 0.3:
            self._go(self.sp.p[i, 0], self.sp.p[i, 1], self.climb_to)
        else:
            self._go(x, y, self.climb_to)
            if away < 0.5 and math.hypot(self.est.v[i, 0], self.est.v[i, 1]) < 0.5:
                self._arrived_at = self.now
        return None

    def _return_height(self, away: float) -> float:
        """Return the height [m] above home in which a vehicle so far away [m] returns."""
        s = self.settings
        if s.return_cone:
            return min(s.return_altitude, away / math.tan(s.return_cone))
        return 0.0 if away < s.acceptance_radius else s.return_altitude

    def _fly_mission(self) -> Mode | None:
        if self.mission_seq >= len(self.mission):
            self._control(Control.IDLE if self.landed else self._holding)
            return Mode.HOLD if self.settings.mission_ends_in_hold else None
        item = self.mission[self.mission_seq]
        if item.command == MissionCommand.NAV_RETURN_TO_LAUNCH:
            return Mode.RETURN
        if item.command == MissionCommand.NAV_LAND:
            self._mission_land(item)
        elif item.command in (MissionCommand.NAV_WAYPOINT, MissionCommand.NAV_TAKEOFF):
            self._mission_go(item)
        else:  # done as soon as it comes up
            if item.command == MissionCommand.DO_CHANGE_SPEED and item.speed > 0.0:
                self.sp.limits[self.i, 0] = item.speed
            self._next_item()
        return None

    def _mission_land(self, item: Waypoint) -> None:
        x, y, _ = item.p
        p = self.est.p[self.i]
        if math.isnan(self._arrived_at) and math.hypot(p[0] - x, p[1] - y) > 1.0:
            self._go(x, y, self.sp.p[self.i, 2])
            return
        self._arrived_at = self.now
        self._descend(x, y)
        if self.landed:
            self._next_item()

    def _mission_go(self, item: Waypoint) -> None:
        i, p = self.i, self.est.p[self.i]
        climbing = item.command == MissionCommand.NAV_TAKEOFF
        x, y = (self.sp.p[i, 0], self.sp.p[i, 1]) if climbing else item.p[:2]
        self._go(x, y, item.p[2])
        away = math.hypot(p[0] - x, p[1] - y)
        if away > 1.0:
            self.sp.yaw[i] = math.atan2(y - p[1], x - p[0])
        radius = item.radius or self.settings.acceptance_radius
        if abs(p[2] - item.p[2]) > MISSION_HEIGHT or away > radius:
            self._arrived_at = math.nan
            return
        if math.isnan(self._arrived_at):
            self._arrived_at = self.now
        if self.now - self._arrived_at >= item.stay:
            self._next_item()

    def _next_item(self) -> None:
        self.reached.append(self.mission_seq)
        self.mission_seq += 1
        self._arrived_at = math.nan
