"""A Betaflight over MSP on one side, a MAVLink vehicle on the other; no sockets, no clock.

`read` takes the controller's answers, `receive` the companion's messages, `cycle` says what
goes out to both. Watchdog: setpoints that stop mean level sticks at once; where a pilot stands
by, the link is released to him, and where nobody does, the vehicle stays, then lands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mavlink_bridge.autopilots.betaflight import MODES, PILOT
from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.coarse_state import CoarseState
from mavlink_bridge.betaflight.controller import Controller
from mavlink_bridge.betaflight.level_flight import LevelFlight
from mavlink_bridge.betaflight.msp import Reply
from mavlink_bridge.betaflight.polling import Answer, read_answer
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.ids import AutopilotId
from mavlink_bridge.wire.messages import (
    Attitude,
    AutopilotVersion,
    BatteryStatus,
    Command,
    CommandAck,
    CommandId,
    CommandResult,
    GpsInput,
    Heartbeat,
    LocalPosition,
    Message,
    RateSetpoint,
    Received,
    StatusText,
    TimeSync,
)

_RATES_AND_THRUST = 128
_QUADROTOR = 2
_AUTOPILOT = 1  # MAV_COMP_ID
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
_ERROR, _INFO = 3, 6
_FIX_3D = 3
_SPEED_MAX = 100.0  # m/s; what says more is wrong
_FORCE = 21196.0
_IDLE = 1100.0  # µs of throttle; more lifts or may lift
_LANDED, _LOW = 2.0, 1.0  # s without throttle so low [m]: it stands
_NAMES = {number: name for name, number in MODES.items()}


@dataclass(frozen=True)
class BridgeTimes:
    """When the bridge acts by itself [s].

    setpoint: silence that ends offboard. release: from the last setpoint to the last frame where a
    pilot stands by; Betaflight holds that one for 0.3 s more, then he has the sticks. land: from
    the last setpoint to landing where there is no pilot. arm: patience with the arming switch.
    settle: Betaflight zeroes its height at arming; no take-off before. silent: without answers
    the controller counts as lost. fix: so long a position is believed without one.
    """

    setpoint: float = 0.2
    release: float = 0.3
    land: float = 5.0
    arm: float = 1.5
    settle: float = 1.0
    silent: float = 0.5
    fix: float = 1.0
    heartbeat: float = 0.5


@dataclass
class Output:
    """What one cycle sends: an RC frame (or none: released), and messages to the companion."""

    rc: bytes = b""
    messages: list[Message] = field(default_factory=list)


def _credible(v: Vector | None) -> bool:
    """Whether a velocity [m/s] can be that of a vehicle; none given is."""
    return v is None or bool((np.abs(v) <= _SPEED_MAX).all())  # False for NaN


class BetaflightBridge:
    """One bridged vehicle. Times are CLOCK_MONOTONIC seconds, which are its boot clock too."""

    def __init__(
        self,
        system: int,
        controller: Controller,
        thrust: ThrustMap,
        angle_limit: float,
        times: BridgeTimes | None = None,
    ) -> None:
        """angle_limit: lean at full stick in ANGLE mode [rad]."""
        self.mode = "hold" if controller.sole else "pilot"
        self.armed = False
        self._system, self._controller, self._limit = system, controller, angle_limit
        self._times = times or BridgeTimes()
        self._state = CoarseState(silent=self._times.silent, unfixed=self._times.fix)
        self._level = LevelFlight(thrust)
        self._lifted = False  # since arming, throttle was given, by whomever
        self._armed_at = self._throttle_at = -math.inf
        self._arm_switch = False
        self._arm_asked: float | None = None
        self._reasons = 0
        self._overridden = controller.sole
        self._setpoint: RateSetpoint | None = None
        self._setpoint_at = -math.inf
        self._lost_at: float | None = None
        self._answered = self._cycled = -math.inf
        self._heartbeat_at = -math.inf
        self._told = ("", False)
        self._gps: tuple[float, ...] = ()
        self._battery = (0.0, 0.0)
        self._outbox: list[Message] = []

    # --- from the controller -------------------------------------------------------------

    def read(self, time: float, reply: Reply) -> None:
        """An answer of the controller, at `time` [s]; one that cannot be read counts as none."""
        answer = read_answer(reply)
        if answer is None:
            return
        # What the pilot does; at the first answer also what was done before this bridge came.
        theirs = self.mode == "pilot" or not math.isfinite(self._answered)
        self._answered, self._battery = time, answer.battery
        self._read_status(time, answer, theirs)
        self._read_motion(time, answer)
        if (state := self._state.at(time, placed=False)) is not None:
            self._outbox.append(Attitude(time, state.q_wb, state.omega))
        if (state := self._state.at(time)) is not None:
            self._outbox.append(LocalPosition(time, state.p, state.v))

    def _read_motion(self, time: float, answer: Answer) -> None:
        s, imu, resting = self._state, answer.imu, not self._lifted
        s.advance(time)
        s.gyro(imu.omega)
        roll, pitch, heading = answer.attitude
        # Whole degrees were cut off, not rounded.
        s.angles(roll, pitch, math.pi / 2 - heading - math.radians(0.5))
        s.force(imu.force, resting)
        s.height(answer.height, resting)
        gps = answer.gps
        if gps is None:
            return
        now = (gps.latitude_deg, gps.longitude_deg, *gps.v)
        if gps.fix and now != self._gps:
            self._gps = now
            s.gps(gps.latitude_deg, gps.longitude_deg, gps.v)
        elif gps.fix:
            s.fixed()

    def _read_status(self, time: float, answer: Answer, theirs: bool) -> None:
        """theirs: what it does is not this bridge's doing."""
        status = answer.status
        armed, before = bool(status.modes >> self._controller.arm_bit & 1), self.armed
        self._reasons, self.armed = status.arming_disabled, armed
        if before and not armed:
            self._arm_switch = self._lifted = False
            self._say(_INFO, "Disarmed")
            self._enter("hold" if self._controller.sole else "pilot")
        elif armed and not before:
            self._armed_at = time
            self._say(_INFO, "Armed")
        if armed and theirs:  # what is taken over goes on
            self._arm_switch = True
            self._watch_throttle(time, answer.throttle > _IDLE)
        if self._controller.override_bit is not None:
            self._watch_override(bool(status.modes >> self._controller.override_bit & 1))
        if self._arm_asked is not None and (armed or time - self._arm_asked > self._times.arm):
            if not armed:
                self._arm_switch = False
                self._say(_ERROR, "Arming denied: " + self._why())
            self._arm_asked = None

    def _watch_throttle(self, time: float, up: bool) -> None:
        """Whether it was lifted by somebody else, or put down again."""
        if up:
            self._lifted, self._throttle_at = True, time
        state = self._state.at(time, placed=False)
        if time - self._throttle_at > _LANDED and state is not None and state.p[2] < _LOW:
            self._lifted = False

    def _watch_override(self, on: bool) -> None:
        """The pilot hands over and takes back by his switch."""
        if self._overridden and not on:
            self._enter("pilot")
        elif on and not self._overridden:
            self._enter("hold")
            self._level.stay()
        self._overridden = on

    def _why(self) -> str:
        names = [n for n in msp.arming_reasons(self._reasons) if n != "ARM_SWITCH"]
        return " ".join(names) or "no reason given"

    # --- from the companion --------------------------------------------------------------

    def receive(self, time: float, received: Received) -> None:
        """A message of the companion or a ground station, at `time` [s]."""
        m = received.message
        if isinstance(m, RateSetpoint):
            self._follow(time, m)
        elif isinstance(m, Command) and self._means_me(m):
            result = self._command(time, m)
            source = received.source
            self._outbox.append(CommandAck(m.command, result, source.system, source.component))
        elif isinstance(m, GpsInput) and m.fix_type >= _FIX_3D and _credible(m.v):
            self._state.gps(m.latitude_deg, m.longitude_deg, m.v, age=0.0)
        elif isinstance(m, TimeSync) and m.tc1 == 0:
            self._outbox.append(TimeSync(round(time * 1e9), m.ts1))

    def _means_me(self, m: Command | RateSetpoint) -> bool:
        """Whether it is for this vehicle's autopilot: a gimbal's commands are none of ours."""
        ours = m.target_system in (0, self._system)
        return ours and m.target_component in (0, _AUTOPILOT)

    def _follow(self, time: float, m: RateSetpoint) -> None:
        sane = bool(np.isfinite(m.omega).all()) and math.isfinite(m.thrust)
        if m.type_mask == _RATES_AND_THRUST and sane and self._means_me(m):
            self._setpoint, self._setpoint_at = m, time

    def _command(self, time: float, m: Command) -> int:
        if m.command == CommandId.COMPONENT_ARM_DISARM:
            return self._arm(time, m.params[0] == 1.0, m.params[1] == _FORCE)
        if m.command == CommandId.REQUEST_MESSAGE and m.params[0] == 148.0:
            self._outbox.append(AutopilotVersion(0x40 | 0x2000, self._version(), self._system))
            return CommandResult.ACCEPTED
        if m.command == CommandId.NAV_TAKEOFF:
            return self._take_off(time, m.params[6])
        numbers = {CommandId.NAV_LAND: MODES["land"], CommandId.DO_SET_MODE: m.params[1]}
        if m.command not in numbers:
            return CommandResult.UNSUPPORTED
        number = numbers[CommandId(m.command)]
        mode = _NAMES.get(int(number)) if math.isfinite(number) else None
        if mode not in ("hold", "land", "offboard"):
            return CommandResult.DENIED
        return self._change(time, mode)

    def _version(self) -> int:
        major, minor, patch = (int(n) for n in self._controller.version.split("."))
        return major << 24 | minor << 16 | patch << 8 | 0xFF

    def _arm(self, time: float, wanted: bool, force: bool) -> int:
        if not wanted:
            return self._disarm(force)
        reasons = [n for n in msp.arming_reasons(self._reasons) if n != "ARM_SWITCH"]
        if self.armed or self._arm_asked is not None:
            return CommandResult.ACCEPTED
        if reasons or self.mode == "pilot" or self._state.at(time) is None:
            flown = self.mode == "pilot"
            why = self._why() if reasons else "pilot flies" if flown else "no position"
            self._say(_ERROR, "Arming denied: " + why)
            return CommandResult.TEMPORARILY_REJECTED
        self._arm_switch, self._arm_asked = True, time
        return CommandResult.ACCEPTED

    def _disarm(self, force: bool) -> int:
        if self.armed and self.mode == "pilot":
            self._say(_ERROR, "Disarming denied: pilot flies")
            return CommandResult.TEMPORARILY_REJECTED
        if self.armed and self._lifted and not force and not self._level.grounded:
            self._say(_ERROR, "Disarming denied: in flight")
            return CommandResult.DENIED
        self._arm_switch, self._arm_asked = False, None
        return CommandResult.ACCEPTED

    def _take_off(self, time: float, height: float) -> int:
        if self._pilots():
            return CommandResult.TEMPORARILY_REJECTED
        state = self._state.at(time)
        if not self.armed or state is None or not height > 0.0:
            return CommandResult.DENIED
        if time - self._armed_at < self._times.settle:
            return CommandResult.TEMPORARILY_REJECTED
        if self.mode != "takeoff":
            self._enter("takeoff")
            self._lifted = True
            self._level.stay(float(state.p[2]) + height)
        return CommandResult.ACCEPTED

    def _change(self, time: float, mode: str) -> int:
        if self._pilots():
            return CommandResult.TEMPORARILY_REJECTED
        if mode == "offboard" and time - self._setpoint_at > self._times.setpoint:
            self._say(_ERROR, "Offboard refused: no setpoints")
            return CommandResult.TEMPORARILY_REJECTED
        if mode != self.mode:
            self._enter(mode)
            self._level.stay()
        return CommandResult.ACCEPTED

    def _pilots(self) -> bool:
        """Whether it is the pilot's turn, until his switch hands over (again); says so."""
        if self.mode == "pilot":
            self._say(_ERROR, "Mode refused: the pilot flies")
        return self.mode == "pilot"

    def _enter(self, mode: str) -> None:
        self.mode = mode
        self._lost_at = None
        if mode == "pilot":  # what he does now with his switch is his
            self._arm_switch, self._arm_asked = self.armed, None

    # --- out -----------------------------------------------------------------------------

    def cycle(self, time: float) -> Output:
        """One cycle at `time` [s]: 50 Hz or more."""
        dt = min(time - self._cycled, 0.1) if math.isfinite(self._cycled) else 0.0
        self._cycled = time
        self._watch(time)
        out = Output(self._rc(time, dt))
        news = (self.mode, self.armed)
        if time - self._heartbeat_at >= self._times.heartbeat or news != self._told:
            self._heartbeat_at, self._told = time, news
            self._outbox += [self._heartbeat(time), BatteryStatus(*self._battery, -0.01)]
        out.messages, self._outbox = self._outbox, []
        return out

    def _watch(self, time: float) -> None:
        """Modes that end by themselves."""
        state = self._state.at(time, placed=False)
        if self.mode == "offboard" and time - self._setpoint_at > self._times.setpoint:
            self._say(_ERROR, "Setpoints stopped: level")
            self._enter("hold")
            self._level.stay()
            self._lost_at = self._setpoint_at
        elif self.mode == "takeoff" and state is not None and self._level.reached(state):
            self._enter("hold")
        elif self.mode == "land" and self.armed and self._level.grounded:
            self._arm_switch = False
        if self._lost_at is None or not self.armed:
            return
        if self._controller.sole:
            if time - self._lost_at > self._times.land:
                self._change(time, "land")
        elif time - self._lost_at > self._times.release:
            self._say(_ERROR, "Released to the pilot")
            self._enter("pilot")

    def _rc(self, time: float, dt: float) -> bytes:
        """The RC frame; none where the pilot flies."""
        if self.mode == "pilot":
            return b""
        controller, setpoint = self._controller, self._setpoint
        if not self.armed:
            channels = controller.channels(np.zeros(3), 0.0, self._arm_switch, True)
        elif self.mode == "offboard" and setpoint is not None:
            self._lifted = True
            sticks = np.array(controller.rate_sticks(setpoint.omega))
            channels = controller.channels(sticks, setpoint.thrust, self._arm_switch, False)
        elif not self._lifted:
            channels = controller.channels(np.zeros(3), 0.0, self._arm_switch, True)
        else:
            state, placed = self._state.at(time, placed=False), self._state.at(time) is not None
            lean = self._level.step(state, dt, self.mode == "land", placed)
            sticks = np.array([lean.right, lean.forward, 0.0]) / self._limit
            channels = controller.channels(sticks, lean.thrust, self._arm_switch, True)
        return msp.raw_rc(channels)

    def parting(self) -> bytes:
        """The last RC frame, for when the bridge ends: level; none where the pilot flies."""
        if self.mode == "pilot":
            return b""
        thrust = self._level.step(None, 0.0).thrust if self.armed and self._lifted else 0.0
        return msp.raw_rc(self._controller.channels(np.zeros(3), thrust, self._arm_switch, True))

    def _heartbeat(self, time: float) -> Heartbeat:
        silent = time - self._answered > self._times.silent
        lost = silent or self._lost_at is not None
        status = _CRITICAL if lost else _ACTIVE if self.armed else _STANDBY
        return Heartbeat(
            AutopilotId.GENERIC, _QUADROTOR, self.armed, MODES.get(self.mode, PILOT), status, 1
        )

    def _say(self, severity: int, text: str) -> None:
        self._outbox.append(StatusText(severity, text[:50]))
