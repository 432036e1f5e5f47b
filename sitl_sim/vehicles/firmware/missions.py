"""The mission protocol of one vehicle: upload, download, progress."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from mavlink_bridge.wire.messages import (
    Message,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    MissionSetCurrent,
    Source,
)
from sitl_sim.vehicles.firmware.guidance import Guidance, Waypoint
from sitl_sim.vehicles.firmware.ids import (
    GLOBAL_FRAMES,
    AltitudeFrame,
    MissionCommand,
    MissionResult,
    MissionType,
)
from sitl_sim.worlds.geodesy import LocalFrame

WITH_PLACE = (MissionCommand.NAV_WAYPOINT, MissionCommand.NAV_TAKEOFF, MissionCommand.NAV_LAND)
KEPT = (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)
SIZE_MAX = 500
RETRY_US, TIMEOUT_US = 250_000, 5_000_000  # PX4's mavlink_mission.h
SLOW_RETRY_US, LONG_TIMEOUT_US = 1_000_000, 8_000_000  # ArduCopter's


@dataclass
class _Upload:
    """A plan that comes: from whom, of which kind, how many items, and when they were asked for."""

    to: tuple[int, int]
    kind: int
    count: int
    link: str
    heard_us: int
    floating: bool = False
    asked_us: int = 0
    items: list[MissionItem] = field(default_factory=list)

    def request(self, now_us: int) -> MissionRequest:
        """Ask for the next item."""
        self.asked_us = now_us
        return MissionRequest(*self.to, len(self.items), self.kind, self.floating)


class Missions:
    """The plans of one vehicle as uploaded; its guidance gets the mission as waypoints.

    Fence and rally points are kept, and change no flight.
    A vehicle that waits for an item asks again for some seconds. strict_places: as ArduCopter,
    which refuses a place off the Earth or in another frame and an item out of turn, and asks by the
    old MISSION_REQUEST.
    """

    def __init__(
        self, frame: LocalFrame, guidance: Guidance, first_is_home: bool, strict_places: bool
    ) -> None:
        self._frame, self._guidance, self._first_is_home = frame, guidance, first_is_home
        self._strict = strict_places
        self._plans: dict[int, list[MissionItem]] = {}
        self._upload: _Upload | None = None

    @property
    def items(self) -> list[MissionItem]:
        """The mission's items."""
        return self._plans.get(MissionType.MISSION, [])

    def answer(self, source: Source, m: Message, link: str, now_us: int) -> list[Message]:
        """Answer a message of the mission protocol that came by `link`."""
        to = (source.system, source.component)
        if isinstance(m, MissionCount):
            return self._begin(to, m, link, now_us)
        if isinstance(m, MissionItem):
            return self._take(to, m, now_us)
        if isinstance(m, MissionRequestList):
            if self._strict and m.mission_type not in KEPT:
                return [MissionAck(*to, MissionResult.UNSUPPORTED, m.mission_type)]
            return [MissionCount(*to, len(self._plans.get(m.mission_type, [])), m.mission_type)]
        if isinstance(m, MissionRequest):
            return self._send(to, m)
        if isinstance(m, MissionClearAll):
            kinds = list(KEPT) if m.mission_type == MissionType.ALL else [m.mission_type]
            for kind in kinds:
                self._store(kind, [])
            return [MissionAck(*to, MissionResult.ACCEPTED, m.mission_type)]
        if isinstance(m, MissionSetCurrent):
            return self._set_current(m)
        return []

    def repeated(self, link: str, now_us: int) -> list[Message]:
        """Return the request for an item that should have come on this link, where it is due."""
        u = self._upload
        if u is None or u.link != link:
            return []
        retry, timeout = RETRY_US, TIMEOUT_US
        if self._strict:
            retry, timeout = SLOW_RETRY_US, LONG_TIMEOUT_US
        if now_us - u.heard_us > timeout:
            self._upload = None
            cancelled = MissionAck(*u.to, MissionResult.OPERATION_CANCELLED, u.kind)
            return [cancelled] if self._strict else []
        if now_us - u.asked_us <= retry:
            return []
        return [u.request(now_us)]

    def _begin(self, to: tuple[int, int], m: MissionCount, link: str, now_us: int) -> list[Message]:
        if m.mission_type not in KEPT:
            result = MissionResult.UNSUPPORTED if m.count else MissionResult.ACCEPTED
            return [MissionAck(*to, result, m.mission_type)]
        if m.count > SIZE_MAX:
            return [MissionAck(*to, MissionResult.NO_SPACE, m.mission_type)]
        if m.count == 0:
            self._store(m.mission_type, [])
            return [MissionAck(*to, MissionResult.ACCEPTED, m.mission_type)]
        self._upload = _Upload(to, m.mission_type, m.count, link, now_us, floating=self._strict)
        return [self._upload.request(now_us)]

    def _take(self, to: tuple[int, int], m: MissionItem, now_us: int) -> list[Message]:
        u = self._upload
        if u is None or m.mission_type != u.kind:
            return [MissionAck(*to, MissionResult.ERROR, m.mission_type)]
        u.heard_us = now_us
        if m.seq != len(u.items):
            if self._strict:
                return [MissionAck(*to, MissionResult.INVALID_SEQUENCE, m.mission_type)]
            return [u.request(now_us)]  # a repeated or lost item: ask again
        flaw = _flaw(m, self._strict) if u.kind == MissionType.MISSION else MissionResult.ACCEPTED
        if flaw:
            self._upload = None
            return [MissionAck(*to, flaw)]
        u.items.append(m)
        if len(u.items) < u.count:
            return [u.request(now_us)]
        self._store(u.kind, u.items)
        return [MissionAck(*to, MissionResult.ACCEPTED, u.kind)]

    def _send(self, to: tuple[int, int], m: MissionRequest) -> list[Message]:
        items = self._plans.get(m.mission_type, [])
        if not 0 <= m.seq < len(items):
            result = MissionResult.INVALID_SEQUENCE if self._strict else MissionResult.ERROR
            return [MissionAck(*to, result, m.mission_type)]
        current = m.mission_type == MissionType.MISSION and m.seq == self._guidance.mission_seq
        item = replace(
            items[m.seq],
            target_system=to[0],
            target_component=to[1],
            current=int(current),
            floating=m.floating,
        )
        return [item]

    def _set_current(self, m: MissionSetCurrent) -> list[Message]:
        if not 0 <= m.seq < max(len(self.items), 1):
            return []
        self._guidance.mission_seq = m.seq
        return [MissionCurrent(m.seq)]

    def _store(self, kind: int, items: list[MissionItem]) -> None:
        self._plans[kind], self._upload = list(items), None
        if kind != MissionType.MISSION:
            return
        self._guidance.mission = [self._waypoint(m) for m in items]
        self._guidance.mission_seq = 0

    def _waypoint(self, m: MissionItem) -> Waypoint:
        _, _, home_z = self._guidance.home
        above_sea = self._frame.reference.altitude
        z = m.z - above_sea if m.frame in list(AltitudeFrame) else home_z + m.z
        somewhere = math.isfinite(m.x_deg) and math.isfinite(m.y_deg) and (m.x_deg or m.y_deg)
        if somewhere:
            x, y = self._frame.from_geo(m.x_deg, m.y_deg)
        else:
            x, y = self._guidance.home[:2]
        stay, radius = (p if math.isfinite(p) else 0.0 for p in m.params[:2])
        home = self._first_is_home and m.seq == 0  # ArduPilot keeps home as item 0
        change_speed = MissionCommand.DO_CHANGE_SPEED
        speed = radius if m.command == change_speed and not home else 0.0
        command = change_speed if home else m.command
        return Waypoint(command, (x, y, z), max(stay, 0.0), max(radius, 0.0), speed)


def _flaw(m: MissionItem, strict: bool) -> int:
    """Return the MAV_MISSION_RESULT for an item; ACCEPTED where it can be flown.

    Take-off and landing may leave latitude and longitude open, as NaN: where the vehicle is. A PX4
    takes any finite place; strict: one that is on the Earth.
    """
    if m.command not in list(MissionCommand):  # gimbal and camera are accepted, and ignored
        return MissionResult.UNSUPPORTED
    if m.command not in WITH_PLACE:
        return MissionResult.ACCEPTED
    if strict and m.frame not in GLOBAL_FRAMES:
        return MissionResult.UNSUPPORTED_FRAME
    for degrees, most, flaw in (
        (m.x_deg, 90.0, MissionResult.INVALID_PARAM5_X),
        (m.y_deg, 180.0, MissionResult.INVALID_PARAM6_Y),
    ):
        left_open = m.command != MissionCommand.NAV_WAYPOINT and math.isnan(degrees)
        on_earth = abs(degrees) <= most if strict else math.isfinite(degrees)
        if not left_open and not on_earth:
            return flaw
    if math.isfinite(m.z) or m.command == MissionCommand.NAV_LAND:
        return MissionResult.ACCEPTED
    return MissionResult.INVALID_PARAM7
