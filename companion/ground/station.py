"""The ground station behind the page: it hears the drones, and asks them for single things.

It never sets the rate of a message: on a shared line that would be the companion's rate, too. It
sends no setpoint, and nothing depends on it: a drone flies the same without it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

from companion.ground.actions import Action
from companion.ground.drone_view import DroneView, Place, metres
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.bytestream import ByteStream
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import AutopilotId, CommandId, MessageId, SystemState, VehicleType
from mavlink_bridge.wire.link import Endpoint
from mavlink_bridge.wire.messages import Command, Heartbeat, Message, Received
from mavlink_bridge.wire.signing import Signing
from mavlink_bridge.wire.udp import Address, UdpEndpoint

COMPONENT = 190  # MAV_COMP_ID_MISSIONPLANNER, as ground stations have
_BEAT = 1.0  # s between heartbeats
_ASK = 2.0  # s between requests for a message that does not come by itself
_ADDRESS_SILENT = 1.5  # s, after which a vehicle may have another address
_PACKETS = 4000  # most that are read at once
_RESULTS = 50  # results of actions that the page shows
_HEARTBEAT = Heartbeat(AutopilotId.INVALID, VehicleType.GCS, False, 0, SystemState.ACTIVE)


class Station:
    """Follows a fleet over one endpoint; `step` often, `snapshot` as often as somebody looks."""

    def __init__(
        self,
        drones: Sequence[CompanionConfig],
        endpoint: Endpoint,
        system: int,
        signing: Signing | None = None,
    ) -> None:
        """system: MAVLink system id of this ground station. signing: of all drones."""
        self.drones = {d.link.system_id: DroneView(d) for d in drones}
        self.system = system
        self.strangers: set[int] = set()  # systems that are heard and are no drone's
        self.results: list[dict[str, Any]] = []
        self.codec = Codec(system, COMPONENT, signing=signing)
        self._endpoint = endpoint
        # A TCP or serial line cuts frames anywhere.
        cuts = isinstance(endpoint, ByteStream)
        self._decode = self.codec.decode if cuts else self.codec.decode_datagram
        self._addresses: dict[int, tuple[Address, float]] = {}
        self._actions: dict[int, Action] = {}
        self._beat_at = self._asked_at = -1e9
        self._number = self._results_told = 0
        self._origin: Place | None = None

    @property
    def names(self) -> list[str]:
        """The names of the drones."""
        return [d.config.name for d in self.drones.values()]

    def named(self, name: str) -> DroneView | None:
        """Return the drone of this name."""
        return next((d for d in self.drones.values() if d.config.name == name), None)

    def act(
        self, action: str, names: Iterable[str], now: float, goals: list[list[float]] | None = None
    ) -> int:
        """Begin an action of each drone named; one under way ends. Return the action's number."""
        self._number += 1
        for name in names:
            drone = self.named(name)
            if drone is None:
                continue
            before = self._actions.pop(drone.system, None)
            if before is not None:
                before.result = "replaced by another"
                self._tell(before, now)
            self._actions[drone.system] = Action(action, drone, now, goals, self._number)
        self._work(now)
        return self._number

    def step(self, now: float) -> None:
        """Read what came, send what is due; now: s, of a clock that never goes back."""
        for data in islice(self._endpoint.receive(), _PACKETS):
            udp = self._endpoint
            place = udp.sender if isinstance(udp, UdpEndpoint) else None
            for r in self._decode(data):
                self.hear(now, r, place)
        if now - self._beat_at >= _BEAT:
            self._beat_at = now
            self._to_all([_HEARTBEAT])
        if now - self._asked_at >= _ASK:
            self._asked_at = now
            for drone in self.drones.values():
                self._send(drone.system, wanted(drone, now))
        self._work(now)

    def hear(self, now: float, r: Received, place: Address | None = None) -> None:
        """Take a message; place: the address it came from, None: not over UDP."""
        drone = self.drones.get(r.source.system)
        if drone is None:
            if r.source.system != self.system and len(self.strangers) < 256:
                self.strangers.add(r.source.system)
            return
        known, at = self._addresses.get(r.source.system, (None, -1e9))
        if place is not None and (known in (None, place) or now - at > _ADDRESS_SILENT):
            self._addresses[r.source.system] = (place, now)
        drone.hear(now, r)
        action = self._actions.get(r.source.system)
        if action is not None:
            action.hear(now, r)

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return the fleet as JSON data; places are metres east and north of the first one."""
        views = list(self.drones.values())
        if self._origin is None:
            self._origin = next((d.origin or d.place for d in views if d.place), None)
        return {
            "time": round(now, 2),
            "origin": self._origin,
            "strangers": sorted(self.strangers),
            "drones": [d.snapshot(now) | self._placed(d) | self._busy(d) for d in views],
        }

    def trails(self) -> dict[str, list[tuple[float, float]]]:
        """Return where each drone was, [m] as in `snapshot`, oldest first."""
        o = self._origin
        return {
            d.config.name: [] if o is None else [metres(o, p) for p in d.trail]
            for d in self.drones.values()
        }

    def words(self, since: dict[str, int]) -> dict[str, list[dict[str, Any]]]:
        """Return what each drone said after so many words, by its name; `since` is brought on."""
        out = {}
        for d in self.drones.values():
            news = min(d.words_total - since.get(d.config.name, 0), len(d.words))
            since[d.config.name] = d.words_total
            if news > 0:
                said = list(d.words)[-news:]
                out[d.config.name] = [
                    {"time": round(w.time, 1), "who": w.who, "bad": w.severity <= 4, "text": w.text}
                    for w in said
                ]
        return out

    def _placed(self, d: DroneView) -> dict[str, Any]:
        """Return a drone's place and goals on the common map [m]; its own frame where none is."""
        if self._origin is None or d.place is None:
            at = None if d.local is None else list(d.local[:2])
            return {"at": at, "goals": [g[:2] for g in d.goals], "own_goals": d.goals}
        shift = (0.0, 0.0) if d.origin is None else metres(self._origin, d.origin)
        goals = [[g[0] + shift[0], g[1] + shift[1]] for g in d.goals] if d.origin else []
        at = [round(v, 2) for v in metres(self._origin, d.place)]
        return {"at": at, "goals": goals, "own_goals": d.goals, "shift": shift}

    def _busy(self, d: DroneView) -> dict[str, Any]:
        action = self._actions.get(d.system)
        return {"busy": "" if action is None else action.name}

    def _work(self, now: float) -> None:
        """Let the actions go on."""
        for system, action in list(self._actions.items()):
            self._send(system, action.due(now))
            if action.result is not None:
                del self._actions[system]
                self._tell(action, now)

    def _tell(self, action: Action, now: float) -> None:
        """Note the result of an action for the page."""
        name, result = action.drone.config.name, action.result or ""
        self._results_told += 1
        self.results.append(
            {
                "id": self._results_told,
                "number": action.number,
                "time": round(now, 1),
                "drone": name,
                "action": action.name,
            }
            | {"ok": action.ok, "result": result}
        )
        del self.results[:-_RESULTS]
        action.drone.say(now, "page", 6 if action.ok else 4, f"{action.name}: {result}")

    def _send(self, system: int, messages: list[Message]) -> None:
        if not messages:
            return
        udp = self._endpoint
        if isinstance(udp, UdpEndpoint):
            if system not in self._addresses:
                return  # never heard
            udp.remote = self._addresses[system][0]
        udp.send(self.codec.encode(messages))

    def _to_all(self, messages: list[Message]) -> None:
        """Send to every address once, or to the one peer of a line."""
        udp = self._endpoint
        if not isinstance(udp, UdpEndpoint):
            udp.send(self.codec.encode(messages))
            return
        known = {place for place, _ in self._addresses.values()}
        for place in known or ({udp.remote} - {None}):  # one that was given hears us first
            udp.remote = place
            udp.send(self.codec.encode(messages))


def wanted(d: DroneView, now: float) -> list[Message]:
    """Return requests for single messages that a drone does not send by itself."""
    missing: list[tuple[int, int]] = []
    me = d.config.link.component_id
    if not d.lost(now):
        known = {
            MessageId.HOME_POSITION: d.origin,
            MessageId.GLOBAL_POSITION_INT: d.place,
            MessageId.SYS_STATUS: d.battery,
            MessageId.EXTENDED_SYS_STATE: d.landed_state or None,
        }
        missing += [(1, number) for number, value in known.items() if value is None]
    if not d.companion_lost(now) and not d.version:
        missing.append((me, MessageId.AUTOPILOT_VERSION))
    return [
        Command(CommandId.REQUEST_MESSAGE, (float(n), *(0.0,) * 6), d.system, component)
        for component, n in missing
    ]


def allowed(config: CompanionConfig, system: int) -> bool:
    """Return whether a drone's companion hears this ground station."""
    me = (system, COMPONENT)
    return any((s.system, s.component) in (me, (system, 0)) for s in config.link.heard())
