"""The mission protocol of one vehicle: upload, download, progress."""

from __future__ import annotations

import math

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
from sitl_sim.vehicles.firmware.ids import AltitudeFrame, MissionCommand, MissionResult, MissionType
from sitl_sim.worlds.geodesy import LocalFrame

WITH_PLACE = (MissionCommand.NAV_WAYPOINT, MissionCommand.NAV_TAKEOFF, MissionCommand.NAV_LAND)
SIZE_MAX = 500


class Missions:
    """The mission of one vehicle as uploaded; its guidance gets it as waypoints."""

    def __init__(self, frame: LocalFrame, guidance: Guidance, first_is_home: bool) -> None:
        self._frame, self._guidance, self._first_is_home = frame, guidance, first_is_home
        self.items: list[MissionItem] = []
        self._coming: list[MissionItem] = []
        self._expected = 0

    def answer(self, source: Source, m: Message) -> list[Message]:
        """Answer a message of the mission protocol; fences and rally points are not kept."""
        to = (source.system, source.component)
        if isinstance(m, MissionCount):
            return self._begin(to, m)
        if isinstance(m, MissionItem):
            return self._take(to, m)
        if isinstance(m, MissionRequestList):
            count = len(self.items) if m.mission_type == MissionType.MISSION else 0
            return [MissionCount(*to, count, m.mission_type)]
        if isinstance(m, MissionRequest):
            return self._send(to, m)
        if isinstance(m, MissionClearAll):
            if m.mission_type in (MissionType.MISSION, MissionType.ALL):
                self._store([])
            return [MissionAck(*to, MissionResult.ACCEPTED, m.mission_type)]
        if isinstance(m, MissionSetCurrent):
            return self._set_current(m)
        return []

    def _begin(self, to: tuple[int, int], m: MissionCount) -> list[Message]:
        if m.mission_type != MissionType.MISSION:
            result = MissionResult.UNSUPPORTED if m.count else MissionResult.ACCEPTED
            return [MissionAck(*to, result, m.mission_type)]
        if m.count > SIZE_MAX:
            return [MissionAck(*to, MissionResult.NO_SPACE)]
        self._coming, self._expected = [], m.count
        if m.count == 0:
            self._store([])
            return [MissionAck(*to, MissionResult.ACCEPTED)]
        return [MissionRequest(*to, 0)]

    def _take(self, to: tuple[int, int], m: MissionItem) -> list[Message]:
        if m.mission_type != MissionType.MISSION or self._expected == 0:
            return [MissionAck(*to, MissionResult.INVALID_SEQUENCE, m.mission_type)]
        if m.seq != len(self._coming):
            return [MissionRequest(*to, len(self._coming))]  # a repeated or lost item: ask again
        if m.command not in list(MissionCommand):  # gimbal and camera are accepted, and ignored
            self._expected = 0
            return [MissionAck(*to, MissionResult.UNSUPPORTED)]
        if flaw := _flaw(m):
            self._expected = 0
            return [MissionAck(*to, flaw)]
        self._coming.append(m)
        if len(self._coming) < self._expected:
            return [MissionRequest(*to, len(self._coming))]
        self._store(self._coming)
        return [MissionAck(*to, MissionResult.ACCEPTED)]

    def _send(self, to: tuple[int, int], m: MissionRequest) -> list[Message]:
        if m.mission_type != MissionType.MISSION or not 0 <= m.seq < len(self.items):
            return [MissionAck(*to, MissionResult.INVALID_SEQUENCE, m.mission_type)]
        i = self.items[m.seq]
        return [
            MissionItem(
                *to,
                m.seq,
                i.frame,
                i.command,
                int(m.seq == self._guidance.mission_seq),
                i.autocontinue,
                i.params,
                i.x_deg,
                i.y_deg,
                i.z,
            )
        ]

    def _set_current(self, m: MissionSetCurrent) -> list[Message]:
        if not 0 <= m.seq < max(len(self.items), 1):
            return []
        self._guidance.mission_seq = m.seq
        return [MissionCurrent(m.seq)]

    def _store(self, items: list[MissionItem]) -> None:
        self.items, self._coming, self._expected = list(items), [], 0
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


def _flaw(m: MissionItem) -> int:
    """Return the MAV_MISSION_RESULT for an item's place; ACCEPTED where it has none.

    Take-off and landing may leave latitude and longitude open, as NaN: where the vehicle is.
    """
    if m.command not in WITH_PLACE:
        return MissionResult.ACCEPTED
    for degrees, most, flaw in (
        (m.x_deg, 90.0, MissionResult.INVALID_PARAM5_X),
        (m.y_deg, 180.0, MissionResult.INVALID_PARAM6_Y),
    ):
        left_open = m.command != MissionCommand.NAV_WAYPOINT and math.isnan(degrees)
        if not left_open and not abs(degrees) <= most:  # also where it is NaN
            return flaw
    if math.isfinite(m.z) or m.command == MissionCommand.NAV_LAND:
        return MissionResult.ACCEPTED
    return MissionResult.INVALID_PARAM7
