"""The mission protocol at the companion: items uploaded to it become its mission's goals.

No I/O and no clock: messages in, messages out. Source: mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from companion.guidance.goals import on_earth
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import (
    HomePosition,
    Message,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    Source,
)

GOALS_MOST = 200
_RETRY, _TRIES = 0.5, 6  # s between requests for one item, and how many there are
_WAYPOINT = 16  # MAV_CMD_NAV_WAYPOINT
_METRES = 1e3  # the wire's units of a local item: 1e-4 m, and 1e-7 where it is read as degrees


class Result(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15


class Frame(IntEnum):
    """MAV_FRAME: those in which a goal may come."""

    GLOBAL = 0
    LOCAL_NED = 1
    GLOBAL_RELATIVE_ALT = 3
    LOCAL_ENU = 4
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6


MISSION_MESSAGES = (
    MissionCount,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    MissionClearAll,
)


def place(item: MissionItem, home: HomePosition | None) -> Vector | None:
    """Return the place of an item (3,) m in the drone's own ENU frame.

    home: where the vehicle's own frame lies on the Earth; None is returned where an item on the
    Earth comes before that is known, and for a frame that is none of `Frame`.
    """
    x, y, z = item.x_deg, item.y_deg, item.z
    if item.frame in (Frame.LOCAL_NED, Frame.LOCAL_ENU):
        scale = 1.0 if item.floating else _METRES
        p = np.array([x * scale, y * scale, z])
        return p if item.frame == Frame.LOCAL_ENU else np.array([p[1], p[0], -p[2]])
    if item.frame not in set(Frame) or home is None:
        return None
    above_home = item.frame in (Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_RELATIVE_ALT_INT)
    return on_earth(x, y, z if above_home else z - home.altitude, home)


@dataclass
class _Upload:
    """A mission that comes: from whom, how many items, and those that are there."""

    sender: Source
    count: int
    asked_at: float
    tries: int = 1
    goals: list[Vector] = field(default_factory=list)

    @property
    def request(self) -> MissionRequest:
        return MissionRequest(self.sender.system, self.sender.component, len(self.goals))


class GoalServer:
    """Takes goals from a ground station, one upload at a time, and shows those in force.

    refusal: returns why a goal (3,) m may not be flown to; empty: it may.
    """

    def __init__(self, goals: list[Vector], refusal: Callable[[Vector], str]) -> None:
        self.goals = goals
        self._refusal = refusal
        self._upload: _Upload | None = None

    def answer(
        self, time: float, sender: Source, m: Message, home: HomePosition | None, accepts: bool
    ) -> tuple[list[Message], list[Vector] | None]:
        """Answer a message of the mission protocol; return the replies, and new goals, if any.

        accepts: whether the companion is in a phase in which its goals may change.
        """
        to = (sender.system, sender.component)
        if getattr(m, "mission_type", 0) != 0:
            return [MissionAck(*to, Result.UNSUPPORTED, getattr(m, "mission_type", 0))], None
        if isinstance(m, MissionRequestList):
            return [MissionCount(*to, len(self.goals))], None
        if isinstance(m, MissionRequest):
            return [self._item(to, m)], None
        if not accepts:
            self._upload = None
            return [MissionAck(*to, Result.DENIED)], None
        if isinstance(m, MissionCount):
            return self._begin(time, sender, m)
        if isinstance(m, MissionClearAll):
            return self._finish(to, [])
        if isinstance(m, MissionItem):
            return self._take(time, sender, m, home)
        return [], None

    def repeated(self, time: float) -> list[Message]:
        """Return the request for an item that should have come; give up after some."""
        u = self._upload
        if u is None or 0.0 <= time - u.asked_at < _RETRY:
            return []
        if u.tries >= _TRIES:
            self._upload = None
            return [MissionAck(u.sender.system, u.sender.component, Result.CANCELLED)]
        u.tries, u.asked_at = u.tries + 1, time
        return [u.request]

    def _begin(
        self, time: float, sender: Source, m: MissionCount
    ) -> tuple[list[Message], list[Vector] | None]:
        to = (sender.system, sender.component)
        if self._upload is not None and self._upload.sender != sender:
            return [MissionAck(*to, Result.DENIED)], None
        if m.count > GOALS_MOST:
            return [MissionAck(*to, Result.NO_SPACE)], None
        if m.count == 0:
            return self._finish(to, [])
        self._upload = _Upload(sender, m.count, time)
        return [self._upload.request], None

    def _take(
        self, time: float, sender: Source, m: MissionItem, home: HomePosition | None
    ) -> tuple[list[Message], list[Vector] | None]:
        to, u = (sender.system, sender.component), self._upload
        if u is None or u.sender != sender:
            return [MissionAck(*to, Result.INVALID_SEQUENCE)], None
        u.asked_at, u.tries = time, 1
        if m.seq != len(u.goals):
            return [u.request], None  # a repeated item, or one came lost
        goal, flaw = self._goal(m, home)
        if goal is None:
            self._upload = None
            return [MissionAck(*to, flaw)], None
        u.goals.append(goal)
        return ([u.request], None) if len(u.goals) < u.count else self._finish(to, u.goals)

    def _goal(self, m: MissionItem, home: HomePosition | None) -> tuple[Vector | None, Result]:
        """Return the goal of an item, or why it is none."""
        if m.command != _WAYPOINT:
            return None, Result.UNSUPPORTED
        p = place(m, home)
        if p is None:
            return None, Result.UNSUPPORTED_FRAME
        if not np.isfinite(p).all() or self._refusal(p):
            return None, Result.INVALID
        return p, Result.ACCEPTED

    def _finish(
        self, to: tuple[int, int], goals: list[Vector]
    ) -> tuple[list[Message], list[Vector] | None]:
        self.goals, self._upload = goals, None
        return [MissionAck(*to, Result.ACCEPTED)], goals

    def _item(self, to: tuple[int, int], m: MissionRequest) -> Message:
        """Return a goal in force as an item in the drone's own frame."""
        if not 0 <= m.seq < len(self.goals):
            return MissionAck(*to, Result.INVALID_SEQUENCE)
        x, y, z = (float(v) for v in self.goals[m.seq])
        scale = 1.0 if m.floating else _METRES
        params = (0.0, 0.0, 0.0, math.nan)
        where = (y / scale, x / scale, -z)
        frame = Frame.LOCAL_NED
        return MissionItem(*to, m.seq, frame, _WAYPOINT, 0, 1, params, *where, 0, m.floating)
