"""A Betaflight over MSP as a MAVLink vehicle; no sockets, no clock.

`read` takes the controller's answers, `receive` the companion's messages, `cycle` returns the
output to both. Watchdog: when setpoints stop, the sticks go level at once. Where a pilot has a
receiver, the bridge then releases the sticks to the pilot; otherwise it waits, holds, then lands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mavlink_bridge.autopilots.betaflight import MODES, PILOT
from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.coarse_state import CoarseState
from mavlink_bridge.betaflight.controller import Controller
from mavlink_bridge.betaflight.fix_source import FixSource
from mavlink_bridge.betaflight.msp import Reply
from mavlink_bridge.betaflight.polling import Answer, read_answer
from mavlink_bridge.betaflight.position_hold import PositionHold
from mavlink_bridge.betaflight.setpoint_watch import SetpointWatch, Silence
from mavlink_bridge.betaflight.times import BridgeTimes
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.ids import (
    AttitudeTargetMask,
    AutopilotId,
    Capability,
    CommandId,
    CommandResult,
    ComponentId,
    MessageId,
    ModeFlag,
    Severity,
    SystemState,
    VehicleType,
)
from mavlink_bridge.wire.messages import (
    Attitude,
    AttitudeTarget,
    AutopilotVersion,
    BatteryStatus,
    Command,
    CommandAck,
    GpsInput,
    Heartbeat,
    LocalPosition,
    Message,
    RateSetpoint,
    Received,
    StatusText,
    TimeSync,
)

_FORCE_DISARM = 21196.0  # parameter 2 of COMPONENT_ARM_DISARM
_IDLE = 1100.0  # µs of throttle; above it the vehicle may lift off
_LANDED_TIME, _LANDED_HEIGHT = 2.0, 1.0  # s of idle throttle below this height [m]: landed
_LONGEST_STEP = 0.1  # s
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_MODE_NAMES = {number: name for name, number in MODES.items()}


@dataclass
class Output:
    """Output of one cycle: an RC frame, empty where the pilot flies, and messages to send."""

    rc: bytes = b""
    messages: list[Message] = field(default_factory=list)


class BetaflightBridge:
    """One bridged vehicle; times are CLOCK_MONOTONIC seconds, which are its boot clock too."""

    def __init__(
        self,
        system: int,
        controller: Controller,
        thrust: ThrustMap,
        angle_limit: float,
        times: BridgeTimes | None = None,
    ) -> None:
        """Start in hold, or in the pilot's mode where a pilot has a receiver.

        angle_limit: tilt at full stick in ANGLE mode [rad].
        """
        self.mode = "hold" if controller.only_receiver else "pilot"
        self.armed = False
        self._system, self._controller, self._limit = system, controller, angle_limit
        self._times = times or BridgeTimes()
        self._state = CoarseState(silent=self._times.silent, unfixed=self._times.fix)
        self._hold = PositionHold(thrust)
        self._lifted = False  # throttle was above idle since arming, by the bridge or the pilot
        self._armed_at = self._throttle_at = -math.inf
        self._arm_switch = False
        self._arm_requested_at: float | None = None
        self._arming_flags, self._override = 0, controller.only_receiver
        self._setpoints = SetpointWatch(self._times.setpoint, self._times.lost)
        self._setpoints_lost_at: float | None = None  # the last one's time, while none come
        self._answered_at = self._cycled_at = -math.inf
        self._heartbeat_at = self._target_at = -math.inf
        self._thrust = 0.0  # of the last RC frame
        self._announced = ("", False, True)
        self._last_fix: tuple[float, ...] = ()
        self._fixes = FixSource(self._times.fix)
        self._battery = (0.0, 0.0)
        self._outbox: list[Message] = []

    # --- from the controller -------------------------------------------------------------

    def read(self, time: float, reply: Reply) -> None:
        """Take an answer of the controller at `time` [s]; an unreadable answer is ignored."""
        answer = read_answer(reply)
        if answer is None:
            return
        # The first answer also shows what happened before this bridge started.
        by_pilot = self.mode == "pilot" or not math.isfinite(self._answered_at)
        self._answered_at, self._battery = time, answer.battery
        self._read_status(time, answer, by_pilot)
        self._read_motion(time, answer)
        if (state := self._state.at(time, need_fix=False)) is not None:
            self._outbox.append(Attitude(time, state.q_wb, state.omega))
        if (state := self._state.at(time)) is not None:
            self._outbox.append(LocalPosition(time, state.p, state.v))

    def _read_motion(self, time: float, answer: Answer) -> None:
        s, imu, resting = self._state, answer.imu, not self._lifted
        s.advance(time)
        s.gyro(imu.omega)
        roll, pitch, heading = answer.attitude
        # Betaflight truncates the heading to whole degrees.
        s.angles(roll, pitch, math.pi / 2 - heading - math.radians(0.5))
        s.force(imu.force, resting)
        s.height(answer.height, resting)
        gps = answer.gps
        if gps is None or not self._fixes.uses_board(time, gps):
            return
        fix = (gps.latitude_deg, gps.longitude_deg, *gps.v)
        if fix != self._last_fix:
            self._last_fix = fix
            s.gps(gps.latitude_deg, gps.longitude_deg, gps.v)
        else:
            s.confirm_fix()

    def _read_status(self, time: float, answer: Answer, by_pilot: bool) -> None:
        """Follow arming and the hand-over switch; by_pilot: the pilot moved arming and throttle."""
        status = answer.status
        armed, before = bool(status.modes >> self._controller.arm_bit & 1), self.armed
        self._arming_flags, self.armed = status.arming_disabled, armed
        if before and not armed:
            self._arm_switch = self._lifted = False
            self._send_text(Severity.INFO, "Disarmed")
            self._enter("hold" if self._controller.only_receiver else "pilot")
        elif armed and not before:
            self._armed_at = time
            self._send_text(Severity.INFO, "Armed")
        if armed and by_pilot:  # a vehicle that is taken over stays armed
            self._arm_switch = True
            self._follow_throttle(time, answer.throttle > _IDLE)
        if self._controller.override_bit is not None:
            self._follow_override(bool(status.modes >> self._controller.override_bit & 1))
        self._finish_arming(time)

    def _finish_arming(self, time: float) -> None:
        """End a request to arm: the controller armed, or did not in time."""
        asked = self._arm_requested_at
        if asked is None or not (self.armed or time - asked > self._times.arm):
            return
        if not self.armed:
            self._arm_switch = False
            self._send_text(Severity.ERROR, "Arming denied: " + self._arming_reasons())
        self._arm_requested_at = None

    def _follow_throttle(self, time: float, above_idle: bool) -> None:
        """Note whether the pilot lifts off, or has landed."""
        if above_idle:
            self._lifted, self._throttle_at = True, time
        state = self._state.at(time, need_fix=False)
        idle_long = time - self._throttle_at > _LANDED_TIME
        if idle_long and state is not None and state.p[2] < _LANDED_HEIGHT:
            self._lifted = False

    def _follow_override(self, on: bool) -> None:
        """Follow the switch by which the pilot hands over and takes back."""
        if self._override and not on:
            self._enter("pilot")
        elif on and not self._override:
            self._enter("hold")
            self._hold.hold_here()
        self._override = on

    def _blocking_flags(self) -> list[str]:
        """Return why the controller would not arm, without the arming switch itself."""
        return [n for n in msp.arming_reasons(self._arming_flags) if n != "ARM_SWITCH"]

    def _arming_reasons(self) -> str:
        return " ".join(self._blocking_flags()) or "no reason given"

    # --- from the companion --------------------------------------------------------------

    def receive(self, time: float, received: Received) -> None:
        """Take a message of the companion or a ground station at `time` [s]."""
        m = received.message
        if isinstance(m, RateSetpoint):
            self._take_setpoint(time, m)
        elif isinstance(m, Command) and self._is_addressed(m):
            result = self._command(time, m)
            source = received.source
            self._outbox.append(CommandAck(m.command, result, source.system, source.component))
        elif isinstance(m, GpsInput) and self._fixes.uses_input(time, m):
            self._state.gps(m.latitude_deg, m.longitude_deg, m.v, age=0.0)
        elif isinstance(m, TimeSync) and m.tc1 == 0:
            self._outbox.append(TimeSync(round(time * 1e9), m.ts1))

    def _is_addressed(self, m: Command | RateSetpoint) -> bool:
        """Return whether a message is for this autopilot, not e.g. for a gimbal of the vehicle."""
        ours = m.target_system in (0, self._system)
        return ours and m.target_component in (0, ComponentId.AUTOPILOT1)

    def _take_setpoint(self, time: float, m: RateSetpoint) -> None:
        finite = bool(np.isfinite(m.omega).all()) and math.isfinite(m.thrust)
        by_rates = m.type_mask == AttitudeTargetMask.ATTITUDE_IGNORE
        if by_rates and finite and self._is_addressed(m):
            self._setpoints.take(time, m)

    def _command(self, time: float, m: Command) -> int:
        """Carry out a command; return the MAV_RESULT."""
        if m.command == CommandId.COMPONENT_ARM_DISARM:
            if m.params[0] == 1.0:
                return self._arm(time)
            return self._disarm(force=m.params[1] == _FORCE_DISARM)
        if m.command == CommandId.REQUEST_MESSAGE and m.params[0] == MessageId.AUTOPILOT_VERSION:
            able = Capability.SET_ATTITUDE_TARGET | Capability.MAVLINK2
            self._outbox.append(AutopilotVersion(able, self._controller.sw_version, self._system))
            return CommandResult.ACCEPTED
        if m.command == CommandId.NAV_TAKEOFF:
            return self._take_off(time, m.params[6])
        numbers = {CommandId.NAV_LAND: MODES["land"], CommandId.DO_SET_MODE: m.params[1]}
        if m.command not in numbers:
            return CommandResult.UNSUPPORTED
        number = numbers[CommandId(m.command)]
        mode = _MODE_NAMES.get(int(number)) if math.isfinite(number) else None
        if mode not in ("hold", "land", "offboard"):
            return CommandResult.DENIED
        return self._change_mode(time, mode)

    def _arm(self, time: float) -> int:
        flags = self._blocking_flags()
        if self.armed or self._arm_requested_at is not None:
            return CommandResult.ACCEPTED
        if flags or self.mode == "pilot" or self._state.at(time) is None:
            other = "pilot flies" if self.mode == "pilot" else "no position"
            self._send_text(Severity.ERROR, "Arming denied: " + (" ".join(flags) or other))
            return CommandResult.TEMPORARILY_REJECTED
        self._arm_switch, self._arm_requested_at = True, time
        return CommandResult.ACCEPTED

    def _disarm(self, force: bool) -> int:
        if self.armed and self.mode == "pilot":
            self._send_text(Severity.ERROR, "Disarming denied: pilot flies")
            return CommandResult.TEMPORARILY_REJECTED
        if self.armed and self._lifted and not force and not self._hold.landed:
            self._send_text(Severity.ERROR, "Disarming denied: in flight")
            return CommandResult.DENIED
        self._arm_switch, self._arm_requested_at = False, None
        return CommandResult.ACCEPTED

    def _take_off(self, time: float, height: float) -> int:
        if self._refused_by_pilot():
            return CommandResult.TEMPORARILY_REJECTED
        state = self._state.at(time)
        if not self.armed or state is None or not height > 0.0:
            return CommandResult.DENIED
        if time - self._armed_at < self._times.settle:
            return CommandResult.TEMPORARILY_REJECTED
        if self.mode != "takeoff":
            self._enter("takeoff")
            self._lifted = True
            self._hold.hold_here(float(state.p[2]) + height)
        return CommandResult.ACCEPTED

    def _change_mode(self, time: float, mode: str) -> int:
        if self._refused_by_pilot():
            return CommandResult.TEMPORARILY_REJECTED
        if mode == "offboard" and self._setpoints.silence(time) is not Silence.NONE:
            self._send_text(Severity.ERROR, "Offboard refused: no setpoints")
            return CommandResult.TEMPORARILY_REJECTED
        if mode != self.mode:
            self._enter(mode)
            self._hold.hold_here()
        return CommandResult.ACCEPTED

    def _refused_by_pilot(self) -> bool:
        """Return whether the pilot flies, until the switch hands over again; send why."""
        if self.mode == "pilot":
            self._send_text(Severity.ERROR, "Mode refused: the pilot flies")
        return self.mode == "pilot"

    def _enter(self, mode: str) -> None:
        self.mode = mode
        self._setpoints_lost_at = None
        if mode == "pilot":  # from now on the arming switch is the pilot's
            self._arm_switch, self._arm_requested_at = self.armed, None

    # --- out -----------------------------------------------------------------------------

    def cycle(self, time: float) -> Output:
        """Return the output at `time` [s]; call it at 50 Hz or more."""
        dt = 0.0
        if math.isfinite(self._cycled_at):
            dt = min(time - self._cycled_at, _LONGEST_STEP)
        self._cycled_at = time
        self._end_modes(time)
        out = Output(self._rc_frame(time, dt))
        now = (self.mode, self.armed, self._setpoints_lost_at is None)
        if time - self._heartbeat_at >= self._times.heartbeat or now != self._announced:
            self._heartbeat_at, self._announced = time, now
            self._outbox += [self._heartbeat(time), BatteryStatus(*self._battery, -0.01)]
        if self.mode != "pilot" and time - self._target_at >= self._times.target:
            self._target_at = time
            self._outbox.append(AttitudeTarget(time, _LEVEL, np.zeros(3), self._thrust))
        out.messages, self._outbox = self._outbox, []
        return out

    def _end_modes(self, time: float) -> None:
        """End a mode that is complete, or whose setpoints stopped."""
        state = self._state.at(time, need_fix=False)
        if self.mode == "offboard":
            self._follow_setpoints(time)
        elif self.mode == "takeoff" and state is not None and self._hold.height_reached(state):
            self._enter("hold")
        elif self.mode == "land" and self.armed and self._hold.landed:
            self._arm_switch = False
        if self._setpoints_lost_at is None or not self.armed:
            return
        missing = time - self._setpoints_lost_at
        if self._controller.only_receiver and missing > self._times.land:
            self._change_mode(time, "land")
        elif not self._controller.only_receiver and missing > self._times.release:
            self._send_text(Severity.ERROR, "Released to the pilot")
            self._enter("pilot")

    def _follow_setpoints(self, time: float) -> None:
        """Hold level while setpoints are late; end offboard when they do not come back."""
        silence = self._setpoints.silence(time)
        if silence is Silence.NONE:
            self._setpoints_lost_at = None
            return
        if self._setpoints_lost_at is None:
            self._send_text(Severity.ERROR, "Setpoints stopped: level")
            self._hold.hold_here()
        if silence is Silence.LONG:
            self._enter("hold")
        self._setpoints_lost_at = self._setpoints.at

    def _rc_frame(self, time: float, dt: float) -> bytes:
        """Return the RC frame, empty where the pilot flies."""
        if self.mode == "pilot":
            return b""
        setpoint = self._setpoints.newest if self._setpoints_lost_at is None else None
        if self.armed and self.mode == "offboard" and setpoint is not None:
            self._lifted = True
            sticks = np.array(self._controller.rate_sticks(setpoint.omega))
            return self._frame(sticks, setpoint.thrust, level=False)
        if not self.armed or not self._lifted:
            return self._frame(np.zeros(3), 0.0)
        state = self._state.at(time, need_fix=False)
        fixed = self._state.at(time) is not None
        angles = self._hold.step(state, dt, self.mode == "land", fixed)
        return self._frame(np.array([angles.roll, angles.pitch, 0.0]) / self._limit, angles.thrust)

    def final_frame(self) -> bytes:
        """Return the last RC frame of a bridge that ends: level; empty where the pilot flies."""
        if self.mode == "pilot":
            return b""
        flying = self.armed and self._lifted
        return self._frame(np.zeros(3), self._hold.step(None, 0.0).thrust if flying else 0.0)

    def _frame(self, sticks: Vector, thrust: float, level: bool = True) -> bytes:
        self._thrust = thrust
        return msp.raw_rc(self._controller.channels(sticks, thrust, self._arm_switch, level))

    def _heartbeat(self, time: float) -> Heartbeat:
        silent = time - self._answered_at > self._times.silent
        status = SystemState.ACTIVE if self.armed else SystemState.STANDBY
        if silent or self._setpoints_lost_at is not None:
            status = SystemState.CRITICAL
        return Heartbeat(
            AutopilotId.GENERIC,
            VehicleType.QUADROTOR,
            self.armed,
            MODES.get(self.mode, PILOT),
            status,
            ModeFlag.CUSTOM_MODE_ENABLED,
        )

    def _send_text(self, severity: Severity, text: str) -> None:
        self._outbox.append(StatusText(severity, text[:50]))
