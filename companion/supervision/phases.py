"""From power-up to landing: when to arm, take off, take control, and let go of it.

Believes HEARTBEAT alone. A pilot's mode change always wins: from the request to arm until it has
landed, whatever mode we did not ask for makes the companion passive for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.guidance.mission import MissionConfig
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Autopilot
from mavlink_bridge.wire.messages import Heartbeat, Message, VehicleState

COMPANION_HEARTBEAT = Heartbeat(autopilot=8, vehicle_type=18, armed=False, custom_mode=0,
                                system_status=4)  # fmt: skip
_ASK_AGAIN = 1.0  # s between repeated requests
_ASK_RELEASE = 0.3  # the same while there are only two seconds left
_ANSWER = 2.0  # s after the request to arm in which an armed vehicle is the answer to it


@dataclass(frozen=True)
class Decision:
    """What follows for this tick: requests to send, and whether setpoints go out."""

    phase: Phase
    requests: list[Message] = field(default_factory=list)
    stream: bool = False


class PhaseMachine:
    """The state machine; one call a tick."""

    def __init__(self, config: MissionConfig, autopilot: Autopilot) -> None:
        self.phase = Phase.WAIT
        self._config = config
        self._autopilot = autopilot
        self._asked = self._asked_to_arm = -1e9
        self._ground = 0.0
        self._releasing = False
        self._landing = self._asked_to_land = False
        self._met = False  # whether a heartbeat has been heard
        self._found_flown = False  # in offboard since it was first heard
        self._by_hand = False  # armed without our asking: nothing is asked of it unasked
        self._mode = ""  # a tick ago
        self._climbs = False  # whether the take-off asked for was seen

    def release(self, land: bool = False) -> None:
        """Give control back: the vehicle is to hold (or to land), then the stream ends."""
        self._releasing = True
        self._landing |= land

    def rebooted(self) -> None:
        """The autopilot started anew: what was asked of it is forgotten, control is not ours."""
        self._asked = self._asked_to_arm = -1e9
        if self.phase is not Phase.WAIT:
            self.phase = Phase.PASSIVE

    def update(
        self,
        time: float,
        heartbeat: Heartbeat | None,
        own: VehicleState | None,
        ready: bool,
        complete: bool,
    ) -> Decision:
        """One tick at `time` [s]; ready: a frame was seen and a plan solved; complete: mission."""
        if heartbeat is None:
            return Decision(self.phase)
        mode, new = self._autopilot.mode(heartbeat), not self._met
        self._meet(time, mode, heartbeat.armed)
        if own is None:  # ArduPilot tells nothing before it is asked
            return Decision(self.phase, self._ask(time, mode) if self.phase is Phase.WAIT else [])
        if self._releasing:
            return self._release(time, mode)
        self._advance(mode, heartbeat.armed, own, ready, complete)
        self._mode = mode
        requests = self._ask(time, mode)
        if new and self.phase is not Phase.WAIT:  # which asks for them until they come
            requests = self._autopilot.request_streams() + requests
        stream = self.phase in (Phase.ENGAGE, Phase.FLY) or (
            self.phase is Phase.LAND and mode == "offboard"
        )
        return Decision(self.phase, requests, stream)

    def _meet(self, time: float, mode: str, armed: bool) -> None:
        """Who starts while the vehicle flies was killed, perhaps: it takes nothing unasked.

        It neither arms by itself, nor goes on in an offboard that it did not see begin. Nor does
        it arm a vehicle that a pilot has flown meanwhile, under his hands when he disarms.
        """
        if not self._met:
            self._met, self._found_flown = True, armed
        self._found_flown &= mode == "offboard"
        if self.phase is Phase.WAIT and armed and time - self._asked_to_arm > _ANSWER:
            self._by_hand = True

    def _ask(self, time: float, mode: str) -> list[Message]:
        """Requests, where they are due."""
        if time - self._asked < _ASK_AGAIN or self.phase in (Phase.DONE, Phase.PASSIVE):
            return []
        requests = self._requests(mode)
        if requests:
            self._asked = time
            if self.phase is Phase.ARM:
                self._asked_to_arm = time
        return requests

    def _advance(
        self, mode: str, armed: bool, own: VehicleState, ready: bool, complete: bool
    ) -> None:
        before = self.phase
        if not armed:
            self._ground = float(own.p[2])
        self._climbs |= before is Phase.TAKEOFF and mode == "takeoff"
        if before is Phase.LAND and not armed:
            self.phase = Phase.DONE
        elif self._taken(mode):
            self.phase = Phase.PASSIVE
        elif before is Phase.WAIT and ready:
            if self._auto:
                self.phase = Phase.TAKEOFF if armed else Phase.ARM
            elif armed and not self._found_flown and self._may_engage(mode, own):
                self.phase = Phase.ENGAGE
        elif before is Phase.ARM and not ready:
            self.phase = Phase.WAIT
        elif before is Phase.ARM and armed:
            self.phase = Phase.TAKEOFF
        elif before is Phase.TAKEOFF and self._is_up(mode, own):
            self.phase = Phase.ENGAGE
        elif before is Phase.ENGAGE and mode == "offboard":
            self.phase = Phase.FLY
        elif before is Phase.FLY and complete and self._config.land:
            self.phase = Phase.LAND
        if before in (Phase.TAKEOFF, Phase.ENGAGE, Phase.FLY) and not armed:
            self.phase = Phase.PASSIVE  # disarmed by somebody: never fight it
        if self.phase is not before:
            self._asked = -1e9

    @property
    def _auto(self) -> bool:
        """Whether to arm, take off and take control without being told."""
        return self._config.auto and not self._by_hand

    def _taken(self, mode: str) -> bool:
        """Whether the mode is none of this phase: a pilot or a failsafe chose it.

        Until it climbs, the vehicle may stay in the mode in which it stood. While it is to land it
        may stay in offboard: the request was lost, and is repeated.
        """
        up = self._autopilot.up_in
        ours = {
            Phase.ARM: (self._mode, up),
            Phase.TAKEOFF: (self._mode, "takeoff", up),
            Phase.FLY: ("offboard",),
            Phase.LAND: ("offboard", "land"),
        }
        if self._auto:  # else it is for the pilot to choose when
            ours[Phase.ENGAGE] = (up, "takeoff", "offboard")
        return mode not in ours.get(self.phase, (mode,))

    def _may_engage(self, mode: str, own: VehicleState) -> bool:
        """Whether setpoints disturb nothing.

        ArduPilot takes them in the very mode in which it takes off: not before it is up. Others
        ignore them until they are in offboard.
        """
        if self._autopilot.up_in == "offboard":
            return self._is_up(mode, own)
        return mode in ("hold", "offboard")

    def _release(self, time: float, mode: str) -> Decision:
        """Stream on until HEARTBEAT shows that the vehicle flies by itself."""
        ours = self.phase in (Phase.ENGAGE, Phase.FLY, Phase.LAND)
        if mode != "offboard" or not ours:
            self.phase = Phase.PASSIVE
            return Decision(self.phase)
        requests: list[Message] = []
        if time - self._asked >= _ASK_RELEASE or self._landing is not self._asked_to_land:
            self._asked, self._asked_to_land = time, self._landing
            landing = self._landing or self.phase is Phase.LAND
            requests = self._autopilot.land() if landing else self._autopilot.hold()
        return Decision(self.phase, requests, stream=True)

    def _is_up(self, mode: str, own: VehicleState) -> bool:
        height = float(own.p[2]) - self._ground
        return mode == self._autopilot.up_in and height > 0.8 * self._config.takeoff_altitude

    def _requests(self, mode: str) -> list[Message]:
        """What to ask of the autopilot now, again each second until HEARTBEAT shows it."""
        a = self._autopilot
        if self.phase is Phase.WAIT:
            return a.request_streams()
        if self.phase is Phase.ARM:
            return a.arm()
        if self.phase is Phase.TAKEOFF and not self._climbs:
            return a.takeoff(self._config.takeoff_altitude)
        if self.phase is Phase.ENGAGE and self._auto:
            return a.offboard()
        if self.phase is Phase.LAND and mode != "land":
            return a.land()
        return []
