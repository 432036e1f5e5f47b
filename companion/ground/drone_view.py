"""One drone as a ground station hears it: what its autopilot and its companion told last.

No I/O and no clock; what is kept is bounded, however long the drone is heard.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

from companion.guidance.goals import resolved
from companion.services.services import FAULTS, PHASES, REASONS
from companion.settings.config import CompanionConfig
from companion.types import Phase
from mavlink_bridge.autopilots.answers import Answers
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.ids import ComponentId, VehicleType
from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    BatteryStatus,
    EstimatorStatus,
    Event,
    ExtendedSystemState,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    HomePosition,
    LocalPosition,
    Message,
    NamedValue,
    Received,
    StatusText,
    SystemStatus,
)

LINK_LOST = 1.5  # s without any message of a vehicle
COMPANION_LOST = 2.5  # s: it sends at 1 Hz
_TRAIL_PERIOD, _TRAIL = 1.0, 600  # s between the places of a trail, and how many are kept
_WORDS = 30  # that are kept
_UNFINISHED = 8  # texts of several chunks whose ends are waited for
_CHUNK, _CHUNKS = 50, 10  # bytes of a full chunk, and the most of one text
_EARTH = 6371000.0  # m, as in `companion.services.goals`
_ON_GROUND = 1
_FIXES = ("no GPS", "no fix", "2D", "3D", "DGPS", "RTK float", "RTK fixed")
Place = tuple[float, float]  # latitude and longitude, degrees


@dataclass(frozen=True)
class Words:
    """What a drone said: when [s], by whom (autopilot, companion or page), how bad, and what."""

    time: float
    who: str
    severity: int
    text: str


def moved(origin: Place, east: float, north: float) -> Place:
    """Return the place so many metres east and north of `origin`."""
    scale = math.cos(math.radians(origin[0]))
    return origin[0] + math.degrees(north / _EARTH), origin[1] + math.degrees(
        east / (_EARTH * scale)
    )


def metres(origin: Place, place: Place) -> tuple[float, float]:
    """Return how far `place` is east and north of `origin` [m]."""
    north = math.radians(place[0] - origin[0]) * _EARTH
    east = math.radians(place[1] - origin[1]) * _EARTH * math.cos(math.radians(origin[0]))
    return east, north


class DroneView:
    """Follows one drone. Times: of the ground station [s]."""

    def __init__(self, config: CompanionConfig) -> None:
        self.config = config
        self.autopilot = adapter(config.link.autopilot, config.link.system_id)
        self.uploaded: list[list[float]] | None = None  # goals that the companion took from here
        self._home: HomePosition | None = None
        self.heard_at = self.companion_at = -math.inf
        self.armed: bool | None = None
        self.mode = ""
        self.landed_state = 0
        self.battery: tuple[float, float] | None = None  # V, 0…1
        self.place: Place | None = None
        self.height: float | None = None  # m over the place of take-off
        self.local: tuple[float, float, float] | None = None  # m, own ENU frame
        self.speed: float | None = None  # m/s
        self.fix: tuple[int, int] | None = None  # GPS_FIX_TYPE, satellites
        self.accuracy: tuple[float, float] | None = None  # m, as the estimator tells
        self.origin: Place | None = None  # of the own frame
        self.version = ""  # of the companion
        self.figures: dict[str, float] = {}  # of the companion
        self.trail: deque[tuple[float, float]] = deque(maxlen=_TRAIL)  # lat, lon
        self.words: deque[Words] = deque(maxlen=_WORDS)
        self.words_total = 0
        self._answers = Answers(self.autopilot)
        self._chunks: dict[tuple[str, int], list[str]] = {}
        self._trail_at = -math.inf

    @property
    def system(self) -> int:
        """MAVLink system id."""
        return self.config.link.system_id

    def lost(self, now: float) -> bool:
        """Return whether the vehicle is not heard any more."""
        return now - self.heard_at > LINK_LOST

    def companion_lost(self, now: float) -> bool:
        """Return whether the companion is not heard any more."""
        return now - self.companion_at > COMPANION_LOST

    @property
    def phase(self) -> Phase | None:
        """The companion's phase; None before it told."""
        phase: Phase | None = _named(PHASES, self.figures.get("phase"))
        return phase

    @property
    def goals(self) -> list[list[float]]:
        """The goals (n,3) m in the own ENU frame; none before the home that they need is known."""
        if self.uploaded is not None:
            return self.uploaded
        goals = resolved(self.config.mission.goals, self._home) or []
        return [[float(v) for v in goal.p] for goal in goals]

    @property
    def in_air(self) -> bool:
        """Whether the vehicle says that it is off the ground."""
        return self.landed_state > _ON_GROUND

    def say(self, now: float, who: str, severity: int, text: str) -> None:
        """Note words; repeated ones only with their new time."""
        if self.words and (self.words[-1].who, self.words[-1].text) == (who, text):
            self.words.pop()
        self.words.append(Words(now, who, severity, text))
        self.words_total += 1

    def hear(self, now: float, r: Received) -> None:
        """Take a message of this drone's system at `now` [s]."""
        if r.source.component == ComponentId.AUTOPILOT1:
            self.heard_at = now
            self._hear_autopilot(now, r.message)
        elif r.source.component == self.config.link.component_id:
            self.companion_at = now
            self._hear_companion(now, r.message)

    def _hear_autopilot(self, now: float, m: Message) -> None:
        if isinstance(m, Heartbeat):
            if m.vehicle_type != VehicleType.GCS:
                self.armed, self.mode = m.armed, self.autopilot.mode(m)
        elif isinstance(m, StatusText):
            self._text(now, "autopilot", m)
        elif isinstance(m, GlobalPosition):
            self._hear_place(now, m)
        elif isinstance(m, LocalPosition):
            self.local = (float(m.p[0]), float(m.p[1]), float(m.p[2]))
        elif isinstance(m, HomePosition):
            self._home = m
            self.origin = moved((m.latitude_deg, m.longitude_deg), -float(m.p[0]), -float(m.p[1]))
        elif isinstance(m, SystemStatus | BatteryStatus):
            self.battery = (m.voltage, m.remaining)
        elif isinstance(m, ExtendedSystemState):
            self.landed_state = m.landed_state
        elif isinstance(m, GpsRaw):
            self.fix = (m.fix_type, m.satellites)
        elif isinstance(m, EstimatorStatus):
            self.accuracy = (m.horizontal_accuracy, m.vertical_accuracy)
        if isinstance(m, Heartbeat | Event):
            for text in self._answers.refusals([m]):
                self.say(now, "autopilot", 4, text)

    def _hear_place(self, now: float, m: GlobalPosition) -> None:
        if not m.latitude_deg and not m.longitude_deg:
            return  # not known
        self.place = (m.latitude_deg, m.longitude_deg)
        self.height = m.relative_altitude
        self.speed = math.hypot(float(m.v[0]), float(m.v[1]))
        if self.origin is None and self.local is not None:
            self.origin = moved(self.place, -self.local[0], -self.local[1])
        if now - self._trail_at >= _TRAIL_PERIOD:
            self._trail_at = now
            self.trail.append(self.place)

    def _hear_companion(self, now: float, m: Message) -> None:
        if isinstance(m, NamedValue):
            before = self.phase
            self.figures[m.name] = float(m.value)
            if m.name == "phase" and self.phase not in (before, None) and before is not None:
                severity = 4 if self.phase is Phase.PASSIVE else 6
                self.say(now, "companion", severity, f"{before.value} → {self.phase.value}")
        elif isinstance(m, StatusText):
            self._text(now, "companion", m)
        elif isinstance(m, AutopilotVersion):
            n = m.flight_sw_version
            self.version = f"{n >> 24}.{n >> 16 & 0xFF}.{n >> 8 & 0xFF}"

    def _text(self, now: float, who: str, m: StatusText) -> None:
        """Take a text, or put the chunks of a long one together."""
        text = m.text.rstrip("\0")
        if m.number:
            key = (who, m.number)
            if len(self._chunks) > _UNFINISHED:
                self._chunks.clear()  # their ends came lost
            parts = self._chunks.setdefault(key, [])
            if m.chunk != len(parts):  # one came lost: what is there is told
                parts.append("…")
            parts.append(text)
            if len(text) == _CHUNK and len(parts) < _CHUNKS:
                return
            text = "".join(self._chunks.pop(key))
        self.say(now, who, m.severity, text)

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return all that the page shows of this drone, as JSON data."""
        f, reason = self.figures, self.figures.get("guard", -1.0)
        lost = self.companion_lost(now)
        guard, camera = _named(REASONS, reason), _named(FAULTS, f.get("camera"))
        companion = {
            "heard": None if math.isinf(self.companion_at) else round(now - self.companion_at, 1),
            "lost": lost,
            "phase": self.phase.value if self.phase else "",
            "guard": guard.value if guard else "",
            "camera": camera.value if camera else "",
            "tick_ms": _rounded(f.get("tick_p99"), 1),
            "neighbours": _rounded(f.get("neighbours"), 0),
            "nearest": _rounded(f.get("nearest"), 2) if f.get("nearest", -1.0) >= 0.0 else None,
            "goal": _rounded(f.get("goal"), 0),
            "hover_doubt": _rounded(f.get("hover_sd"), 3),
            "loss": _rounded(f.get("loss"), 3),
            "version": self.version,
        }
        return {
            "name": self.config.name,
            "system": self.system,
            "kind": self.config.link.autopilot,
            "heard": None if math.isinf(self.heard_at) else round(now - self.heard_at, 1),
            "lost": self.lost(now),
            "armed": self.armed,
            "mode": self.mode,
            "in_air": self.in_air,
            "battery": None if self.battery is None else [round(b, 3) for b in self.battery],
            "height": _rounded(self.height, 2),
            "speed": _rounded(self.speed, 2),
            "fix": None if self.fix is None else f"{_fix(self.fix[0])}, {self.fix[1]} satellites",
            "accuracy": None if self.accuracy is None else [round(a, 2) for a in self.accuracy],
            "place": self.place,
            "local": None if self.local is None else [round(x, 2) for x in self.local],
            "companion": companion,
        }


def _fix(number: int) -> str:
    return _FIXES[number] if number < len(_FIXES) else "fix"


def _named(names: list[Any], number: float | None) -> Any:
    """Return the member at a place of a list; None where there is none."""
    known = number is not None and 0 <= number < len(names)
    return names[int(number)] if known and number is not None else None


def _rounded(value: float | None, digits: int) -> float | None:
    """Return a number that JSON can hold; None where it is none."""
    return round(value, digits) if value is not None and math.isfinite(value) else None
