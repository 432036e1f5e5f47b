"""Phases: from power-up to landing, when to arm, take off, take control, and give it back.

Only HEARTBEAT tells what the vehicle does. A pilot's mode change always wins: from the request to
arm until the landing, a mode that was not asked for makes the companion passive, until it is told
to resume.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from companion.guidance.mission import MissionConfig
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Autopilot
from mavlink_bridge.wire.ids import AutopilotId, SystemState, VehicleType
from mavlink_bridge.wire.messages import Heartbeat, Message, VehicleState

COMPANION_HEARTBEAT = Heartbeat(
    autopilot=AutopilotId.INVALID,
    vehicle_type=VehicleType.ONBOARD_CONTROLLER,
    armed=False,
    custom_mode=0,
    system_status=SystemState.ACTIVE,
)
_REPEAT = 1.0  # s between repeated requests
_REPEAT_RELEASE = 0.3  # s; the same while control is given back, as only two seconds are left
_TAKEOFF_SHOWS = 3.0  # s after the request in which a take-off shows: an ArduCopter is 2 m up then
_ARM_ANSWER = 2.0  # s after the request to arm in which an armed vehicle is the answer to it
_STREAM_FIRST = 0.25  # s of setpoints before offboard is asked for: PX4 refuses it without any
_NEVER = -1e9  # s, before any time


class GiveBack(IntEnum):
    """What the vehicle is to do when control is given back; a later one wins."""

    HOLD = 0
    RETURN = 1
    LAND = 2


@dataclass(frozen=True)
class Decision:
    """What follows for this tick: requests to send, and whether setpoints go out."""

    phase: Phase
    requests: list[Message] = field(default_factory=list)
    stream: bool = False


class PhaseMachine:
    """The state machine of the phases; one call a tick."""

    def __init__(self, config: MissionConfig, autopilot: Autopilot) -> None:
        self.phase = Phase.WAIT
        self._config = config
        self._autopilot = autopilot
        self._requested_at = self._arm_requested_at = self._engaged_at = _NEVER
        self._ground = 0.0
        self._releasing = False
        self._giving = self._given = GiveBack.HOLD  # how control is given back, asked for last
        self._heard = False  # a heartbeat has come
        self._found_in_offboard = False  # armed and in offboard since the first heartbeat
        self._armed_by_pilot = False  # armed without a request: only a pilot's wishes count
        self._mode = ""  # of the last tick
        self.waits_for_thrust = False  # at this tick: all else is ready to take over
        self._takeoff_seen = False  # the vehicle was in the mode of the take-off requested

    def release(self, how: GiveBack = GiveBack.HOLD) -> None:
        """Give control back, then end the stream; of several ways the last in `GiveBack` wins."""
        self._releasing = True
        self._giving = max(self._giving, how)

    def resume(self) -> None:
        """Wait for the pilot again, passive or landed before: as a companion that starts anew.

        It then arms nothing, and takes over only in a change to offboard that it sees begin.
        """
        if self.phase not in (Phase.PASSIVE, Phase.DONE):
            return
        self.phase = Phase.WAIT
        self._releasing, self._heard, self._armed_by_pilot = False, False, True
        self._giving = self._given = GiveBack.HOLD
        self._requested_at = _NEVER

    def rebooted(self) -> None:
        """Give up control of an autopilot that started anew; forget what was requested of it."""
        self._requested_at = self._arm_requested_at = _NEVER
        if self.phase is not Phase.WAIT:
            self.phase = Phase.PASSIVE

    def update(
        self,
        time: float,
        heartbeat: Heartbeat | None,
        own: VehicleState | None,
        ready: bool,
        complete: bool,
        known: bool = True,
        airborne: bool = False,
    ) -> Decision:
        """Return the decision at `time` [s].

        heartbeat: the last one; None where the mode is not known. own: state now. ready: the drone
        is fit to fly. complete: the mission is. known: the hover thrust is; else the vehicle goes
        on flying by itself. airborne: the vehicle has taken off.
        """
        self.waits_for_thrust = False
        if heartbeat is None:
            return Decision(self.phase)
        mode, new = self._autopilot.mode(heartbeat), not self._heard
        self._note_heartbeat(time, mode, heartbeat.armed)
        if own is None:  # ArduPilot sends no telemetry before it is requested
            waits = self.phase is Phase.WAIT
            return Decision(self.phase, self._due_requests(time, mode, airborne) if waits else [])
        if self._releasing:
            return self._release(time, mode, heartbeat.armed)
        before = self.phase
        self._advance(mode, heartbeat.armed, own, ready, complete, known)
        if self.phase is Phase.ENGAGE is not before:
            self._engaged_at = time
        self._mode = mode
        requests = self._due_requests(time, mode, airborne)
        if new and self.phase is not Phase.WAIT:  # in which the streams are requested anyway
            requests = self._autopilot.request_streams() + requests
        stream = self.phase in (Phase.ENGAGE, Phase.FLY) or (
            self.phase is Phase.LAND and mode == "offboard"
        )
        return Decision(self.phase, requests, stream)

    def _note_heartbeat(self, time: float, mode: str, armed: bool) -> None:
        """Note whether the vehicle flew before this companion started, or a pilot armed it.

        A companion that was killed and starts in flight neither arms by itself, nor goes on in an
        offboard mode that it did not see begin. Nor does it arm a vehicle that a pilot has flown
        meanwhile: it would spin up under the pilot's hands after disarming.
        """
        if not self._heard:
            self._heard, self._found_in_offboard = True, armed
        self._found_in_offboard &= mode == "offboard"
        if self.phase is Phase.WAIT and armed and time - self._arm_requested_at > _ARM_ANSWER:
            self._armed_by_pilot = True

    def _due_requests(self, time: float, mode: str, airborne: bool) -> list[Message]:
        """Return the requests of the phase where they are due, again and again until obeyed."""
        repeat = _TAKEOFF_SHOWS if self.phase is Phase.TAKEOFF else _REPEAT
        if time - self._requested_at < repeat or self.phase in (Phase.DONE, Phase.PASSIVE):
            return []
        if self.phase is Phase.ENGAGE and time - self._engaged_at < _STREAM_FIRST:
            return []
        requests = self._requests(mode, airborne)
        if requests:
            self._requested_at = time
            if self.phase is Phase.ARM:
                self._arm_requested_at = time
        return requests

    def _advance(
        self, mode: str, armed: bool, own: VehicleState, ready: bool, complete: bool, known: bool
    ) -> None:
        """Advance to the next phase where its condition holds."""
        before = self.phase
        if not armed:
            self._ground = float(own.p[2])
        self._takeoff_seen |= before is Phase.TAKEOFF and mode == "takeoff"
        if before is Phase.LAND and not armed:
            self.phase = Phase.DONE
        elif self._taken_over(mode):
            self.phase = Phase.PASSIVE
        elif before is Phase.WAIT and ready:
            if self._auto:
                self.phase = Phase.TAKEOFF if armed else Phase.ARM
            elif armed and not self._found_in_offboard and self._may_engage(mode, own):
                self._take_over(known)
        elif before is Phase.ARM and not ready:
            self.phase = Phase.WAIT
        elif before is Phase.ARM and armed:
            self.phase = Phase.TAKEOFF
        elif before is Phase.TAKEOFF and self._is_up(mode, own):
            self._take_over(known)
        elif before is Phase.ENGAGE and mode == "offboard":
            self.phase = Phase.FLY
        elif before is Phase.FLY and complete and self._config.land:
            self.phase = Phase.LAND
        if before in (Phase.TAKEOFF, Phase.ENGAGE, Phase.FLY) and not armed:
            self.phase = Phase.PASSIVE  # disarmed by a pilot or a failsafe, which wins
        if self.phase is not before:
            self._requested_at = _NEVER

    def _take_over(self, known: bool) -> None:
        """Engage where the hover thrust is known; else wait, and say so."""
        self.waits_for_thrust = not known
        if known:
            self.phase = Phase.ENGAGE

    @property
    def waits_for_pilot(self) -> bool:
        """Whether the vehicle has flown in offboard since before this companion started.

        It stays so until a pilot changes the mode.
        """
        return self.phase is Phase.WAIT and self._armed_by_pilot and self._found_in_offboard

    @property
    def _auto(self) -> bool:
        """Whether to arm, take off and take control without being told."""
        return self._config.auto and not self._armed_by_pilot

    def _taken_over(self, mode: str) -> bool:
        """Return whether the mode is none of this phase: a pilot or a failsafe chose it.

        Until it climbs, the vehicle may stay in the mode in which it stood. While it is to land it
        may stay in offboard: the request was lost, and is repeated.
        """
        up = self._autopilot.mode_after_takeoff
        ours = {
            Phase.ARM: (self._mode, up),
            Phase.TAKEOFF: (self._mode, "takeoff", up),
            Phase.FLY: ("offboard",),
            Phase.LAND: ("offboard", "land"),
        }
        if self._auto:  # else the pilot chooses when to change to offboard
            ours[Phase.ENGAGE] = (up, "takeoff", "offboard")
        return mode not in ours.get(self.phase, (mode,))

    def _may_engage(self, mode: str, own: VehicleState) -> bool:
        """Return whether setpoints may go out without disturbing the vehicle.

        ArduPilot obeys them in the mode in which it takes off, so none may go out before it is up.
        Others ignore them until they are in offboard.
        """
        if self._autopilot.mode_after_takeoff == "offboard":
            return self._is_up(mode, own)
        return mode in ("hold", "offboard")

    def _release(self, time: float, mode: str, armed: bool) -> Decision:
        """Return the decision while control is given back: request it, stream until it is shown."""
        ours = self.phase in (Phase.ENGAGE, Phase.FLY, Phase.LAND)
        if mode != "offboard" or not ours or not armed:
            self.phase = Phase.PASSIVE
            return Decision(self.phase)
        requests: list[Message] = []
        due = time - self._requested_at >= _REPEAT_RELEASE
        if due or self._giving is not self._given:
            self._requested_at, self._given = time, self._giving
            how = GiveBack.LAND if self.phase is Phase.LAND else self._giving
            requests = self._way(how)
        return Decision(self.phase, requests, stream=True)

    def _way(self, how: GiveBack) -> list[Message]:
        a = self._autopilot
        ways = {GiveBack.HOLD: a.hold, GiveBack.RETURN: a.rtl, GiveBack.LAND: a.land}
        return ways[how]() or a.hold()  # not every autopilot can return

    def _is_up(self, mode: str, own: VehicleState) -> bool:
        """Return whether the take-off is over."""
        high = self._height(own) > 0.8 * self._config.takeoff_altitude
        return high and mode == self._autopilot.mode_after_takeoff

    def _height(self, own: VehicleState) -> float:
        """Return the height [m] above the place where it was armed."""
        return float(own.p[2]) - self._ground

    def _requests(self, mode: str, airborne: bool) -> list[Message]:
        """Return what to request of the autopilot in this phase, until HEARTBEAT shows it."""
        a = self._autopilot
        if self.phase is Phase.WAIT:
            return a.request_streams()
        if self.phase is Phase.ARM:
            return a.arm()
        if self.phase is Phase.TAKEOFF and not self._takeoff_seen:
            # ArduCopter shows no mode of its own for it, and refuses to take off in the air. By GPS
            # a vehicle on the ground may seem to climb: what it tells itself counts.
            return [] if airborne else a.takeoff(self._config.takeoff_altitude)
        if self.phase is Phase.ENGAGE and self._auto:
            return a.offboard()
        if self.phase is Phase.LAND and mode != "land":
            return a.land()
        return []
