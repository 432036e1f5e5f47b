"""One vehicle's discrete state: armed or not, mode, landed or not, and the failsafes.

Time is the world's, in seconds; `tick` runs at 100 Hz. What a mode asks of the control loops is
in `guidance.py`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from mavlink_bridge.wire.ids import Severity
from mavlink_bridge.wire.messages import CommandResult, Event, RateSetpoint, StatusText
from sitl_sim.vehicles.firmware.arming import Failure, Reporter, failures
from sitl_sim.vehicles.firmware.flavour import FailsafeAction, Flavour, Mode, Settings
from sitl_sim.vehicles.firmware.guidance import Guidance
from sitl_sim.vehicles.firmware.ids import LandedState
from sitl_sim.vehicles.firmware.setpoints import understood
from sitl_sim.vehicles.firmware.sticks import STICKS, Sticks
from sitl_sim.vehicles.rigid_body import State

LANDED_AFTER = 0.5  # s of contact
LIFTED_HEIGHT = 0.05  # m
WITHOUT_POSITION = (Mode.OFFBOARD, Mode.ALTITUDE, Mode.STABILIZED, Mode.LAND)
TEXTS_KEPT = 100  # the newest: a refused request that repeats for hours is answered each time


class Commander:
    """The commander of one vehicle."""

    def __init__(
        self, flavour: Flavour, settings: Settings, guidance: Guidance, state: State
    ) -> None:
        self.flavour, self.settings, self.guidance = flavour, settings, guidance
        self._i, self._state = guidance.i, state
        self.mode = flavour.initial
        self.armed = self.was_armed = False
        self.failsafe = False
        self.failed: set[str] = set()  # of gyro, accelerometer, magnetometer, gps
        self.remaining = 1.0  # battery
        self.said: deque[StatusText | Event] = deque(maxlen=TEXTS_KEPT)
        self.said_total = 0  # since the start
        self.now = self.time_boot = 0.0
        self._reporter = Reporter()
        self._checked: tuple[object, ...] = ()  # of the last report
        self._after_disarming = Mode.HOLD
        self._touched_at = -math.inf
        self._armed_at = self._landed_at = -math.inf
        self._battery_stage = 0
        self.sticks: Sticks | None = None
        guidance.landed = bool(state.contact[self._i])
        self._set_home()

    @property
    def landed(self) -> bool:
        """Whether the vehicle is on the ground and at rest."""
        return self.guidance.landed

    @property
    def landed_state(self) -> LandedState:
        """The state for EXTENDED_SYS_STATE."""
        if self.landed:
            return LandedState.ON_GROUND
        special = {Mode.TAKEOFF: LandedState.TAKEOFF, Mode.LAND: LandedState.LANDING}
        return special.get(self.mode, LandedState.IN_AIR)

    @property
    def armable(self) -> bool:
        """Whether arming would be accepted now."""
        return not self._why_not_armable()

    @property
    def stream_ok(self) -> bool:
        """Whether a setpoint is new enough for offboard (PX4: offboardCheck.cpp)."""
        return self.now - self.guidance.setpoint_at <= self.settings.loss_time

    def say(self, severity: int, text: str) -> None:
        """Queue a STATUSTEXT; a longer one is cut."""
        self._queue(StatusText(severity, text[:50]))

    def report(self, name: str, severity: int) -> None:
        """Queue an EVENT, where this autopilot sends them."""
        if self.flavour.reports_events:
            self._queue(self._reporter.event(self.time_boot, name, severity))

    def _queue(self, message: StatusText | Event) -> None:
        self.said.append(message)
        self.said_total += 1

    @property
    def texts(self) -> list[StatusText]:
        """The newest texts."""
        return [m for m in self.said if isinstance(m, StatusText)]

    def configure(self, settings: Settings) -> None:
        """Take changed parameters."""
        self.settings = self.guidance.settings = settings

    # Requests of companions and ground stations; each returns a MAV_RESULT.

    def arm(self, force: bool = False) -> int:
        """Arm, or send the reason why not."""
        if self.armed:
            return CommandResult.ACCEPTED
        reason = "" if force else self._why_not_armable()
        if reason:
            # PX4 keeps the reason to its EVENTs.
            told = "Resolve system health failures first" if self.flavour.reports_events else reason
            self.say(Severity.CRITICAL, f"{self.flavour.arm_prefix}: {told}")
            self.report("commander_arm_denied_resolve_failures", Severity.CRITICAL)
            return self.flavour.arm_refusal
        self.armed = self.was_armed = True
        self._armed_at = self.guidance.armed_at = self.now
        if self.landed:
            self._set_home()
        self.guidance.begin(self.mode, self.mode)
        self.say(Severity.INFO, self.flavour.armed_words)
        self.report("commander_armed_by", Severity.INFO)
        return CommandResult.ACCEPTED

    def _set_home(self) -> None:
        x, y, z = self.guidance.est.p[self._i]
        self.guidance.home = (float(x), float(y), float(z))

    def _why_not_armable(self) -> str:
        for failure in self._failures():
            if failure.bars(self.mode):
                return failure.words
        if self.mode not in self.flavour.armable:
            return f"{self.flavour.mode_words.get(self.mode, self.mode.name)} mode not armable"
        return ""

    def _failures(self) -> list[Failure]:
        """Return the failed checks, of all modes."""
        empty = self.remaining < self.settings.battery_critical
        stream_ok = self.stream_ok or not self.flavour.stream_first
        return failures(self.failed, empty, stream_ok, bool(self.guidance.mission))

    def run_checks(self) -> int:
        """Report all failed checks once more, on request."""
        self._checked = ()
        self._reporter.forget()
        self._report_checks()
        return CommandResult.ACCEPTED

    def _report_checks(self) -> None:
        """Report the failed checks where they changed."""
        empty = self.remaining < self.settings.battery_critical
        state = (self.mode, len(self.failed), empty, self.stream_ok, bool(self.guidance.mission))
        if self.flavour.reports_events and state != self._checked:
            self._checked = state
            barred = self.mode not in self.flavour.armable
            for report in self._reporter.checks(self.time_boot, self._failures(), barred):
                self._queue(report)

    def disarm(self, force: bool = False) -> int:
        """Disarm on the ground, or anywhere by force."""
        if not self.armed:
            return CommandResult.ACCEPTED
        if not self.landed and not force:
            self.say(Severity.CRITICAL, "Disarming denied: not landed")
            self.report("commander_disarm_denied_not_landed", Severity.CRITICAL)
            return self.flavour.arm_refusal
        self._disarm("Disarmed by external command")
        return CommandResult.ACCEPTED

    def _disarm(self, text: str) -> None:
        self.armed = self.failsafe = False
        self.guidance.stop_motors()
        self.say(Severity.INFO, text)
        self.report("commander_disarmed_by", Severity.INFO)
        if self.flavour.takeoff_mode:
            self._enter(self._after_disarming)

    def set_mode(self, mode: Mode) -> int:
        """Change the mode on request; a PX4 on the ground enters any, and may not arm in it."""
        if self.armed or not self.flavour.stream_first:
            if mode is Mode.OFFBOARD and self.flavour.stream_first and not self.stream_ok:
                return CommandResult.TEMPORARILY_REJECTED
            if mode is Mode.MISSION and not self.guidance.mission and self.flavour.stream_first:
                self.say(Severity.CRITICAL, "Mission refused: no valid mission")
                return CommandResult.TEMPORARILY_REJECTED
        if mode is Mode.MISSION and self.guidance.mission_seq >= len(self.guidance.mission):
            self.guidance.mission_seq = 0
        self.failsafe = False
        if mode not in (Mode.LAND, Mode.RETURN, Mode.TAKEOFF):
            self._after_disarming = mode
        self._enter(mode)
        return CommandResult.ACCEPTED

    def refuse_mode(self, number: int) -> int:
        """Refuse a mode that this autopilot does not have."""
        if not self.flavour.reports_events:
            self.say(Severity.WARNING, f"No such mode {number}")
            return CommandResult.FAILED
        self.say(Severity.CRITICAL, "Unsupported main mode")
        self.report("commander_unsupported_main_mode", Severity.ERROR)
        return CommandResult.TEMPORARILY_REJECTED

    def take_off(self, height: float | None) -> int:
        """Climb to `height` [m] above this place; None: the parameter's height."""
        in_mode = self.flavour.takeoff_mode
        if not in_mode and not (self.armed and self.landed and self.mode is Mode.OFFBOARD):
            return CommandResult.FAILED
        self.failsafe = False
        self._enter(Mode.TAKEOFF if in_mode else Mode.OFFBOARD)
        here = float(self.guidance.est.p[self._i, 2])
        self.guidance.climb_to = here + (height or self.settings.takeoff_altitude)
        return CommandResult.ACCEPTED

    def follow(self, m: RateSetpoint) -> None:
        """Take SET_ATTITUDE_TARGET: body rates or an attitude, with thrust."""
        setpoint = understood(m, self.guidance.setpoint, self.flavour.bad_setpoint_stops)
        if setpoint is not None:
            self.guidance.follow(setpoint, self.armed and self.mode is Mode.OFFBOARD)
        elif self.flavour.bad_setpoint_stops and self.mode is Mode.OFFBOARD:
            self.guidance.stop_following()

    def fly_sticks(self, channels: Sequence[float]) -> None:
        """Take RC channels [µs]: A E T R AUX1 … (Betaflight)."""
        if self.sticks is None or len(channels) < STICKS or not np.isfinite(channels).all():
            return
        self.guidance.follow(self.sticks.setpoint(channels), self.armed)
        wanted = self.sticks.wants_arm(channels)
        if wanted and not self.armed and self.sticks.may_arm(channels):
            self.arm()
        elif self.armed and not wanted:
            self._disarm("Disarmed by switch")

    # What happens without a request.

    def tick(self, now: float) -> None:
        """Detect landings, run failsafes, and fly the mode."""
        self.now = self.guidance.now = now
        self._detect_landing()
        self._check_position()
        self._report_checks()
        if not self.armed:
            return
        self._check_battery()
        if self.sticks is not None:
            self._check_sticks()
        else:
            self._check_stream()
        self._check_rest()
        if not self.armed:
            return
        after = self.guidance.step(self.mode)
        if after is not None:
            if self.mode is Mode.TAKEOFF:
                self._after_disarming = after
            if self.mode is Mode.MISSION and after is Mode.HOLD:
                self.say(Severity.INFO, "Mission finished, loitering")
            self._enter(after)

    def _enter(self, mode: Mode) -> None:
        before, self.mode = self.mode, mode
        self.guidance.begin(mode, before)

    def _detect_landing(self) -> None:
        if not self._state.contact[self._i]:
            self._touched_at = self.now
            if self.landed and self.guidance.feet() > LIFTED_HEIGHT:
                self.guidance.landed = False
        elif not self.landed and self.now - self._touched_at > LANDED_AFTER:
            self.guidance.landed = True
            self._landed_at = self.now
            if self.armed:
                self.say(Severity.INFO, "Landing detected")

    def _check_rest(self) -> None:
        """Disarm a vehicle that has long been armed on the ground."""
        if not self.landed or (self.mode is Mode.OFFBOARD and self.stream_ok):
            return
        s, flown = self.settings, self._landed_at > self._armed_at
        since, limit = (
            (self._landed_at, s.disarm_landed) if flown else (self._armed_at, s.disarm_preflight)
        )
        if limit > 0.0 and self.now - since > limit:
            self._disarm("Disarmed by landing" if flown else "Disarmed: no takeoff after arming")

    def _check_stream(self) -> None:
        s = self.settings
        if self.mode is not Mode.OFFBOARD or s.loss_action is FailsafeAction.LEVEL:
            return
        if self.now - self.guidance.setpoint_at > s.loss_time:
            self._act(s.loss_action, "offboard lost")

    def _check_position(self) -> None:
        """Level and land where the position is lost, unless the mode needs none."""
        ok = "gps" not in self.failed
        lost, self.guidance.position_ok = self.guidance.position_ok and not ok, ok
        flying = self.armed and not self.landed
        if lost and flying and self.mode not in WITHOUT_POSITION:
            self._act(FailsafeAction.LAND, "position lost")

    def _check_sticks(self) -> None:
        if self.now - self.guidance.setpoint_at > self.settings.loss_time:
            self.say(Severity.EMERGENCY, "Failsafe: RC lost, dropping")
            self._disarm("Disarmed by failsafe")
            if self.sticks is not None:
                self.sticks.failsafe()

    def _check_battery(self) -> None:
        s = self.settings
        stage = (self.remaining < s.battery_low) + (self.remaining < s.battery_critical)
        if stage <= self._battery_stage:
            return
        self._battery_stage = stage
        if stage == 1:
            self.say(Severity.WARNING, "Low battery")
        else:
            self.say(Severity.EMERGENCY, "Critical battery")
        if stage == 2 and s.battery_action is not FailsafeAction.HOLD and not self.landed:
            self._act(s.battery_action, "battery")

    def _act(self, action: FailsafeAction, why: str) -> None:
        modes = {FailsafeAction.LAND: Mode.LAND, FailsafeAction.RETURN: Mode.RETURN}
        mode = modes.get(action, Mode.HOLD)
        self.say(Severity.EMERGENCY, f"Failsafe: {why}, {mode.name.lower()}")
        self.report("commander_failsafe_enter_generic", Severity.ERROR)
        self._enter(mode)
        self.failsafe = True
