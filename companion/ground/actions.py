"""What a ground station asks of one drone, step by step, until the drone shows that it does it.

No I/O and no clock. An acknowledgement says that a command was understood: PX4 acknowledges modes
that it then does not enter. So each action ends with what the drone shows, or with its words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from companion.ground.drone_view import DroneView
from companion.ground.goal_upload import GoalUpload
from companion.types import Phase
from mavlink_bridge.wire.ids import CommandId, CommandResult
from mavlink_bridge.wire.messages import Command, CommandAck, Heartbeat, Message, Received

_REPEAT, _TRIES = 0.7, 3  # s between two tries of one command, and how many there are
_WORDS = 1.0  # s that the words of a refusal may come after it
_IN_A_ROW = 2  # heartbeats; PX4 leaves a mode again that it should not have entered
_FINE = (CommandResult.ACCEPTED, CommandResult.IN_PROGRESS)
_NO_ANSWER = "no answer"


@dataclass(frozen=True)
class Shown:
    """How a drone shows that it does what it was told: `what` holds, as `by` tells, in `within` s.

    steady: by two heartbeats in a row.
    """

    what: str
    by: Callable[[DroneView], bool]
    within: float
    steady: bool = True


@dataclass(frozen=True)
class Step:
    """Messages of which the last command counts, to which component, and what shows it."""

    messages: Sequence[Message]
    component: int
    shown: Shown | None = None


_OFFBOARD = Shown("in offboard", lambda d: d.mode == "offboard", 5.0)
_FLIES = Shown("flown by its companion", lambda d: d.phase is Phase.FLY, 6.0, steady=False)


def _engaged(d: DroneView) -> bool:
    """Return whether the companion is ready for the change of the mode."""
    ready = [Phase.ENGAGE, Phase.FLY]
    if not d.armed or d.autopilot.mode_after_takeoff == "offboard":
        ready.append(Phase.WAIT)  # it sends nothing before offboard
    return d.phase in ready


def steps(action: str, d: DroneView) -> list[Step]:
    """Return the steps of an action for this drone; none: it cannot be asked for that."""
    a, companion = d.autopilot, d.config.link.component_id
    if action == "arm":
        return [Step(a.arm(), 1, Shown("armed", lambda v: v.armed is True, 5.0))]
    if action == "takeoff":
        up = Shown("off the ground", lambda v: v.armed is True and v.in_air, 10.0)
        climb = Step(a.takeoff(d.config.mission.takeoff_altitude), 1, up)
        # ArduPilot takes off in guided mode alone.
        first = [Step(a.offboard(), 1)] if a.mode_after_takeoff == "offboard" else []
        return [*first, climb]
    if action == "start":
        return [Step(a.offboard(), 1, _OFFBOARD)]
    if action == "hold":
        return [Step(a.hold(), 1, Shown("holding", lambda v: v.mode == "hold", 5.0))]
    if action == "return" and a.rtl():
        return [Step(a.rtl(), 1, Shown("returning", lambda v: v.mode == "rtl", 5.0))]
    if action == "land":
        down = Shown("landing", lambda v: v.mode == "land" or v.armed is False, 5.0)
        return [Step(a.land(), 1, down)]
    if action == "resume":
        go_on = Command(CommandId.DO_PAUSE_CONTINUE, (1.0, *(0.0,) * 6), d.system, companion)
        ready = Shown("standing by", _engaged, 6.0, steady=False)
        stand_by = Step([go_on], companion, ready)
        return [stand_by, Step(a.offboard(), 1, _OFFBOARD), Step([], companion, _FLIES)]
    return []


def refusal(action: str, d: DroneView, now: float) -> str:
    """Return why an action would lead nowhere, from what the drone tells; empty: ask it."""
    if d.lost(now):
        return "its vehicle is not heard"
    silent = d.companion_lost(now)
    if action in ("resume", "goals") and silent:
        return "its companion is not heard"
    if action == "start" and d.armed is False:
        return "its vehicle is disarmed: arm it, and take off"
    if action == "start" and not silent and d.phase in (Phase.PASSIVE, Phase.DONE):
        return f"its companion is {d.phase.value if d.phase else ''}: resume it"
    return ""


class Action:
    """One action under way; `result` is None until it ended. ok: whether it was done."""

    def __init__(
        self,
        name: str,
        drone: DroneView,
        now: float,
        goals: list[list[float]] | None = None,
        number: int = 0,
    ) -> None:
        self.name, self.drone, self.number = name, drone, number
        self.result: str | None = None
        self.ok = False
        self._said = drone.words_total
        self._steps = steps(name, drone)
        self._upload = GoalUpload(drone, goals) if goals is not None else None
        self._sent: list[Command] = []
        self._refused, self._end_at = "", 0.0  # why it ends, once its words may have come
        reason = refusal(name, drone, now)
        if reason or not (self._steps or self._upload):
            self.result = reason or f"{drone.config.link.autopilot} has no mode for that"
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Begin the first of the steps that are left."""
        self._todo = list(self._steps[0].messages) if self._steps else []
        self._tries, self._tried_at = 0, -1e9
        self._shown_in_a_row, self._until = 0, 0.0
        self._shown_by: float | None = None if self._todo else now  # since when it is waited for

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now, and end the action where its time is over."""
        if self.result is not None:
            return []
        if self._refused:
            if now >= self._end_at:
                self.result = f"{self._refused}: {self._state()}"
            return []
        if self._upload is not None:
            messages = self._upload.due(now)
            self._finish_upload()
            return messages
        if not self._todo:
            self._watch(now)
            return []
        return self._try(now)

    def _try(self, now: float) -> list[Message]:
        """Send the message whose turn it is; parameters go out together with the next command."""
        if now - self._tried_at < _REPEAT:
            return []
        if self._tries >= _TRIES or (self._tries and len(self._todo) > 1):
            self._answered(now, _NO_ANSWER)
            return []
        out: list[Message] = []
        while self._todo and not isinstance(self._todo[0], Command):
            out.append(self._todo.pop(0))
        command = self._todo[0]
        assert isinstance(command, Command)
        self._tried_at = now
        out.append(replace(command, confirmation=self._tries))
        self._tries += 1
        return out

    def hear(self, now: float, r: Received) -> None:
        """Take a message of the drone that may answer this action."""
        if self.result is not None or self._refused:
            return
        if self._upload is not None:
            self._upload.hear(now, r)
            self._finish_upload()
            return
        if not self._steps or r.source.component != self._steps[0].component:
            return
        if isinstance(r.message, CommandAck):
            self._acknowledged(now, r.message)
        elif isinstance(r.message, Heartbeat) and self._shown_by is not None:
            shown = self._steps[0].shown
            held = shown is not None and shown.by(self.drone)
            self._shown_in_a_row = self._shown_in_a_row + 1 if held else 0

    def _acknowledged(self, now: float, m: CommandAck) -> None:
        last = self._steps[0].messages[-1:] if not self._todo else self._todo[:1]
        command = last[0] if last else None
        if not isinstance(command, Command) or m.command != command.command:
            return
        if m.result in _FINE:
            if self._todo:
                self._answered(now, "")
            return
        known = m.result in {r.value for r in CommandResult}
        name = CommandResult(m.result).name.lower().replace("_", " ") if known else str(m.result)
        self._answered(now, f"refused ({name})")

    def _answered(self, now: float, problem: str) -> None:
        """Go on to the next message; of a step only what its last command meets counts."""
        if problem and len(self._todo) <= 1:
            self._refused = problem
            self._end_at = now if problem == _NO_ANSWER else now + _WORDS
            return
        self._todo = self._todo[1:]
        self._tries, self._tried_at = 0, -1e9
        if not self._todo:
            self._shown_by = now

    def _watch(self, now: float) -> None:
        """Go on to the next step where the drone shows this one."""
        shown, since = self._steps[0].shown, self._shown_by
        assert since is not None
        if shown is None:
            done = True
        elif shown.steady:
            done = self._shown_in_a_row >= _IN_A_ROW
        else:
            done = shown.by(self.drone)
        if not done:
            if shown is not None and now - since > shown.within:
                self._refused = f"accepted, but not {shown.what} within {shown.within:g} s"
                self._end_at = now
            return
        self._steps = self._steps[1:]
        on_ground = self.name == "resume" and not self.drone.armed
        if not self._steps or on_ground:
            self.ok = True
            self.result = "standing by: arm, take off and start it" if on_ground else "done"
            return
        self._begin(now)

    def _finish_upload(self) -> None:
        u = self._upload
        if u is not None and u.result is not None:
            self.ok = not u.result
            self.result = (u.result and f"refused: {u.result}") or f"done: {len(u.goals)} goals"
            if self.ok:
                self.drone.uploaded = u.goals

    def _state(self) -> str:
        """Return the drone's state, and its own words since the action began."""
        d = self.drone
        armed = {True: "armed", False: "disarmed", None: "no heartbeat"}[d.armed]
        phase = f", companion {d.phase.value}" if d.phase else ""
        news = min(d.words_total - self._said, len(d.words))
        texts = [w for w in list(d.words)[len(d.words) - news :] if w.who != "page"]
        said = "; ".join(dict.fromkeys(f"{w.who}: {w.text}" for w in texts))
        return f"{armed}, mode {d.mode or 'unknown'}{phase}" + (f"; {said}" if said else "")
