"""The companion as a MAVLink component: heartbeat, figures, answers, goals and requests.

Ground stations reach it by the allowed sources of `link.allow`; what a stranger sends never gets
here. No I/O and no clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from companion.guidance.fence import FenceConfig
from companion.perception.camera_health import CameraFault
from companion.perception.config import CameraConfig
from companion.services.goals import MISSION_MESSAGES, GoalServer
from companion.supervision.guard import Reason
from companion.types import Phase, Track
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.wire.ids import (
    AutopilotId,
    Capability,
    CommandId,
    CommandResult,
    MessageId,
    Severity,
    SystemState,
    VehicleType,
)
from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    CameraInformation,
    Command,
    CommandAck,
    ComponentInformation,
    Heartbeat,
    HomePosition,
    Message,
    NamedValue,
    Ping,
    Received,
    Source,
    StatusText,
    VehicleState,
)

_PERIOD = 0.99  # s between heartbeats, and between figures: a tick may come a little early
_TICKS = 100  # whose times the figure tick_p99 is of
_NAN = float("nan")
_UNIQUE = 0x5357_0000  # plus the system id
_CAPABILITIES = int(Capability.MISSION_INT | Capability.MISSION_FLOAT | Capability.MAVLINK2)
PHASES = list(Phase)  # their places are the numbers of the figure `phase`
REASONS = list(Reason)  # likewise of `guard`; -1: no command
FAULTS = list(CameraFault)  # likewise of `camera`
_SAID_AGAIN = 10.0  # s between two STATUSTEXTs of the same words
_TEXT = 50  # bytes of one STATUSTEXT


class Wish(Enum):
    """What a ground station asks the companion to do with the vehicle that it flies."""

    NONE = "nothing"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    RESUME = "resume"  # stand by again for a vehicle that was given back


_WISHES = {
    CommandId.DO_PAUSE_CONTINUE: Wish.HOLD,
    CommandId.NAV_RETURN_TO_LAUNCH: Wish.RETURN,
    CommandId.NAV_LAND: Wish.LAND,
}
_PAUSE, _CONTINUE = 0.0, 1.0  # param1 of DO_PAUSE_CONTINUE
_UNRESUMABLE = (Phase.ARM, Phase.TAKEOFF, Phase.LAND)


@dataclass(frozen=True)
class Situation:
    """What the services tell of the tick before.

    reason: of the guard's command; None: none went out. neighbours: how many are tracked; nearest:
    m, the distance to the nearest, infinite without any. hover_doubt: 1 σ as a share of the hover
    thrust. packet_loss: share of the telemetry. goal: index of the present one; -1: none. words:
    why the companion does not take over, or what it found wrong; empty: all is well.
    """

    phase: Phase
    reason: Reason | None = None
    neighbours: int = 0
    camera: CameraFault = CameraFault.NONE
    nearest: float = np.inf
    hover_doubt: float = 0.0
    packet_loss: float = 0.0
    goal: int = -1
    words: str = ""


@dataclass(frozen=True)
class Served:
    """Messages to send, and what ground stations asked for: a wish, and new goals (3,) m."""

    messages: list[Message] = field(default_factory=list)
    wish: Wish = Wish.NONE
    goals: list[Vector] | None = None


class Services:
    """Answers for the component `own`; one call a tick."""

    def __init__(
        self,
        own: Source,
        camera: CameraConfig,
        fence: FenceConfig,
        goals: list[Vector],
        wishes: frozenset[Wish],
    ) -> None:
        """own: system and component. wishes: those that the autopilot can be asked for."""
        self._own, self._camera, self._wishes = own, camera, wishes
        self._fence = fence
        self._goals = GoalServer(goals, self._out_of_bounds)
        self._home: HomePosition | None = None
        self._beat_at = self._figures_at = self._said_at = -np.inf
        self._told = Situation(Phase.WAIT)  # by the last figures
        self._said, self._texts = "", 0
        self._times: deque[float] = deque(maxlen=_TICKS)
        self._time = 0.0
        self._messages: dict[int, Callable[[], Message]] = {
            MessageId.CAMERA_INFORMATION: self._camera_information,
            MessageId.AUTOPILOT_VERSION: self._version,
            MessageId.COMPONENT_INFORMATION_BASIC: self._component_information,
        }

    def reset(self) -> None:
        """Forget what hangs on the vehicle's clock and place: it has started anew."""
        self._beat_at = self._figures_at = self._said_at = -np.inf
        self._home = None

    def took(self, seconds: float) -> None:
        """Note the time that a tick took [s]."""
        self._times.append(seconds)

    def update(self, time: float, received: Sequence[Received], now: Situation) -> Served:
        """Return what is to be sent at `time` [s], and what was asked for since the last tick."""
        self._time = time
        replies: list[Message] = []
        wish, goals = Wish.NONE, None
        for r in received:
            if isinstance(r.message, HomePosition) and r.source == Source(self._own.system, 1):
                self._home = r.message
            if not self._is_for_me(r):
                continue
            if isinstance(r.message, MISSION_MESSAGES):
                accepts = now.phase in (Phase.WAIT, Phase.FLY)
                more, new = self._goals.answer(time, r.source, r.message, self._home, accepts)
                replies += more
                goals = goals if new is None else new
            elif isinstance(r.message, Command):
                more, asked = self._command(r.source, r.message, now.phase)
                replies += more
                wish = wish if asked is Wish.NONE else asked
            elif isinstance(r.message, Ping) and r.message.target_system == 0:
                answer = (r.message.time, r.message.sequence, r.source.system, r.source.component)
                replies.append(Ping(*answer))
        replies += self._goals.repeated(time)
        return Served([*self._unasked(time, now), *replies], wish, goals)

    def _is_for_me(self, r: Received) -> bool:
        """Return whether a message asks this component; it never answers the component itself."""
        if r.source == self._own:
            return False
        if isinstance(r.message, Ping):
            return True
        system = getattr(r.message, "target_system", 0)
        component = getattr(r.message, "target_component", 0)
        return (system, component) == (self._own.system, self._own.component)

    def _command(self, sender: Source, m: Command, phase: Phase) -> tuple[list[Message], Wish]:
        """Return the answer to a command, and the wish that it stands for."""
        result, messages, wish = CommandResult.UNSUPPORTED, [], Wish.NONE
        if m.command == CommandId.REQUEST_MESSAGE:
            make = self._messages.get(int(m.params[0])) if np.isfinite(m.params[0]) else None
            result = CommandResult.DENIED if make is None else CommandResult.ACCEPTED
            messages = [] if make is None else [make()]
        elif m.command in _WISHES:
            result, asked = self._may(m, phase)
            wish = asked if result == CommandResult.ACCEPTED else wish
        ack = CommandAck(m.command, result, sender.system, sender.component)
        return [ack, *messages], wish

    def _may(self, m: Command, phase: Phase) -> tuple[CommandResult, Wish]:
        """Return whether a wish is met, and which: only for a vehicle that this companion flies.

        To go on after a pause is to stand by: the vehicle is retaken only by a change of its mode,
        which the pilot or the ground station makes. Asked twice, as where the answer is lost, it
        is granted twice.
        """
        wish = _WISHES[CommandId(m.command)]
        refused, granted = CommandResult.TEMPORARILY_REJECTED, CommandResult.ACCEPTED
        if wish is Wish.HOLD and m.params[0] == _CONTINUE:
            return refused if phase in _UNRESUMABLE else granted, Wish.RESUME
        if wish is Wish.HOLD and m.params[0] != _PAUSE:
            return CommandResult.DENIED, wish
        if wish not in self._wishes:
            return CommandResult.UNSUPPORTED, wish
        return granted if phase.on_mission else refused, wish

    def _unasked(self, time: float, now: Situation) -> list[Message]:
        """Return heartbeat, figures and words where they are due; a new phase is told at once."""
        due: list[Message] = []
        changed = now.phase is not self._told.phase
        if changed or time - self._beat_at >= _PERIOD:
            self._beat_at = time
            due.append(heartbeat(now))
        if changed or time - self._figures_at >= _PERIOD:
            self._figures_at, self._told = time, now
            due += self._figures(time, now)
        # New words wait, too: where they hold a number, they change each tick.
        wait = _SAID_AGAIN if now.words == self._said else _PERIOD
        if now.words and time - self._said_at >= wait:
            self._said, self._said_at = now.words, time
            due += self._texted(now.words)
        return due

    def _figures(self, time: float, now: Situation) -> list[Message]:
        slow = float(np.percentile(self._times, 99)) * 1e3 if self._times else 0.0
        figures: dict[str, float | int] = {
            "phase": PHASES.index(now.phase),
            "guard": -1 if now.reason is None else REASONS.index(now.reason),
            "tick_p99": slow,
            "neighbours": now.neighbours,
            "nearest": float(now.nearest) if np.isfinite(now.nearest) else -1.0,
            "camera": FAULTS.index(now.camera),
            "goal": now.goal,
            "hover_sd": float(now.hover_doubt),
            "loss": float(now.packet_loss),
        }
        return [NamedValue(time, name, value) for name, value in figures.items()]

    def _texted(self, words: str) -> list[Message]:
        """Return STATUSTEXTs of 50 bytes each that together hold the words; the last is shorter."""
        data = words.replace("±", "+-").encode("ascii", "replace")
        # A text that fills its last chunk ends with an empty one: else the receiver waits for more.
        pieces = [data[i : i + _TEXT].decode() for i in range(0, len(data) + 1, _TEXT)]
        self._texts = self._texts % 0xFFFF + 1
        number = self._texts if len(pieces) > 1 else 0
        return [StatusText(Severity.WARNING, p, number, n) for n, p in enumerate(pieces)]

    def _out_of_bounds(self, goal: Vector) -> str:
        beyond, _ = self._fence.across(goal, np.zeros(3))
        low = goal[2] < self._fence.goal_min
        return "outside the fence" if beyond > 0.0 or low else ""

    def _camera_information(self) -> CameraInformation:
        """Return the camera of the settings; a fisheye's focal length in mm is not known."""
        c = self._camera
        return CameraInformation(
            self._time, "swarm-companion", "forward", _NAN, _NAN, _NAN, c.width, c.height, 0
        )

    def _version(self) -> AutopilotVersion:
        return AutopilotVersion(_CAPABILITIES, _packed(_release()), _UNIQUE + self._own.system)

    def _component_information(self) -> ComponentInformation:
        names = ("swarm-companion", "companion", _release(), str(_UNIQUE + self._own.system))
        return ComponentInformation(self._time, _CAPABILITIES, *names)


def nearest(own: VehicleState | None, tracks: Sequence[Track]) -> float:
    """Return the distance [m] to the nearest track; infinite where there is none, or no own."""
    if own is None:
        return np.inf
    return min((norm(t.p - own.p) for t in tracks), default=np.inf)


def heartbeat(now: Situation) -> Heartbeat:
    """Return the companion's own HEARTBEAT: critical where the guard does not follow the plan."""
    state = SystemState.STANDBY
    if now.phase.flying:
        planned = now.reason in (None, Reason.PLAN)
        state = SystemState.ACTIVE if planned else SystemState.CRITICAL
    kind = VehicleType.ONBOARD_CONTROLLER
    return Heartbeat(AutopilotId.INVALID, kind, False, 0, state)


def _release() -> str:
    """Return the version of this software; empty where it is not installed."""
    try:
        return version("swarm-companion")
    except PackageNotFoundError:
        return ""


def _packed(release: str) -> int:
    """Return a version as AUTOPILOT_VERSION has it: a byte for each part."""
    parts = release.split(".")[:3]
    numbers = [int(p) if p.isdecimal() else 0 for p in (*parts, "0", "0", "0")][:3]
    return numbers[0] << 24 | numbers[1] << 16 | numbers[2] << 8 | 0xFF
