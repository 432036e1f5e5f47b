"""Actions on many vehicles from a ground station, by MAVSDK; never setpoints.

MAVSDK's offboard plugin is not used even for the change of mode: it would send setpoints of its
own, from a thread that goes on while everything else hangs.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk, System
from mavsdk.asyncio.exceptions import MavsdkConnectionError
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import log_subscribe
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from companion.ground.row import Row
from companion.ground.vehicle_monitor import VehicleMonitor
from companion.settings.config import CompanionConfig
from mavlink_bridge.autopilots.registry import Autopilot, adapter
from mavlink_bridge.wire.messages import Command, CommandResult, Message
from mavlink_bridge.wire.udp import EndpointError

_FIRST = 2.0  # s for the first message of each telemetry stream
_RATE = 2.0  # Hz
_WORDS = 1.0  # s that the STATUSTEXT of a refusal may come after its acknowledgement
_URLS = (
    "valid: udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT, "
    "serial://DEVICE:BAUD; no other program may hold it"
)
_Value = TypeVar("_Value")


class Refused(Exception):
    """A vehicle that refuses a command; the text is the MAV_RESULT."""


@dataclass(frozen=True)
class Shown:
    """How a vehicle shows that it does an action: `what` holds, as `by` tells, in `within` s."""

    what: str
    by: Callable[[VehicleMonitor], bool]
    within: float


# An acknowledgement says that a command was understood: PX4 acknowledges modes that it then does
# not enter.
SHOWN = {
    "arm": Shown("armed", lambda v: v.armed is True, 5.0),
    "takeoff": Shown("off the ground", lambda v: v.armed is True and v.in_air, 10.0),
    "start": Shown(
        "in offboard (is its companion running, and streaming?)",
        lambda v: v.mode == "offboard",
        5.0,
    ),
    "hold": Shown("holding", lambda v: v.mode == "hold", 5.0),
    "land": Shown("landing", lambda v: v.mode == "land" or v.armed is False, 5.0),
}


async def act(
    action: str, drones: Sequence[CompanionConfig], url: str, patience: float
) -> list[Row]:
    """Do `action` with every drone as soon as it is heard; return a row for each.

    No drone waits for another: one that is to hold or to land may be about to collide.

    url: where the vehicles speak to ground stations, as MAVSDK writes it. patience: s, for vehicles
    to appear.

    Raises:
        EndpointError: the URL cannot be opened; the message names it.
    """
    log_subscribe(lambda *line: True)  # handled here: MAVSDK would print each vehicle it finds
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        try:
            await mavsdk.add_any_connection(url)
        except MavsdkConnectionError as error:
            raise EndpointError(f"{url}: {error}; {_URLS}") from error
        deadline = time.monotonic() + patience
        rows = [_one(action, d, _find(mavsdk, d.link.system_id, deadline)) for d in drones]
        return list(await asyncio.gather(*rows))


async def _find(mavsdk: Mavsdk, wanted: int, deadline: float) -> System | None:
    """Return the vehicle of this system id; None where it does not appear in time."""
    while True:
        for system in await mavsdk.get_systems():
            if await system.get_system_id() == wanted and await system.has_autopilot():
                return system
        if time.monotonic() > deadline:
            return None
        await asyncio.sleep(0.1)


async def _one(action: str, drone: CompanionConfig, heard: Awaitable[System | None]) -> Row:
    row = Row(drone.name, drone.link.system_id)
    system = await heard
    if system is None:
        return row
    try:
        async with VehicleMonitor(system, _autopilot(drone)) as monitor:
            problem = await _try(action, drone, system, monitor)
    except RuntimeError as error:  # a plugin of MAVSDK that cannot be made
        problem = str(error)
    row.ok, row.result = not problem, problem or "done"
    await _state(row, system)
    return row


async def _try(action: str, drone: CompanionConfig, system: System, monitor: VehicleMonitor) -> str:
    """Do the action and wait until the vehicle shows it; return why not, empty where it does."""
    try:
        await _do(action, drone, system)
    except (MavsdkError, Refused) as error:
        await asyncio.sleep(_WORDS)
        reason = error.result.name if isinstance(error, ActionError) else error
        return f"refused ({reason}): {monitor.state()}"
    if action not in SHOWN:
        return ""
    shown = SHOWN[action]
    if await monitor.shows(shown.by, shown.within):
        return ""
    return f"accepted, but not {shown.what} within {shown.within:g} s: {monitor.state()}"


def _autopilot(drone: CompanionConfig) -> Autopilot:
    return adapter(drone.link.autopilot, drone.link.system_id)


async def _do(action: str, drone: CompanionConfig, system: System) -> None:
    """Ask one vehicle for one action.

    Raises:
        MavsdkError, Refused: the vehicle refuses, or does not answer.
    """
    autopilot = _autopilot(drone)
    modes = {"start": autopilot.offboard, "hold": autopilot.hold, "land": autopilot.land}
    if action in modes:  # for `start` the mode alone: the setpoints are the companion's own
        await _send(modes[action](), system)
    elif action == "arm":
        await ActionAsync(system).arm()
    elif action == "takeoff":
        if autopilot.mode_after_takeoff == "offboard":
            await _send(autopilot.offboard(), system)  # ArduPilot takes off in guided mode alone
        actions = ActionAsync(system)
        await actions.set_takeoff_altitude(drone.mission.takeoff_altitude)
        await actions.takeoff()


async def _send(requests: Iterable[Message], system: System) -> None:
    """Send the commands among the requests, each as soon as the one before is accepted.

    Raises:
        MavsdkError, Refused: the vehicle does not answer, or refuses.
    """
    direct = MavlinkDirectAsync(system)
    for request in requests:
        if not isinstance(request, Command):
            continue
        fields: dict[str, Any] = {f"param{n}": p for n, p in enumerate(request.params, start=1)}
        fields |= {
            "target_system": request.target_system,
            "target_component": request.target_component,
            "command": request.command,
            "confirmation": 0,
        }
        message = MavlinkMessage(
            "COMMAND_LONG", 255, 190, request.target_system, 1, json.dumps(fields)
        )
        ack = json.loads((await direct.send_command(message)).fields_json)
        if ack["result"] != CommandResult.ACCEPTED:
            raise Refused(CommandResult(ack["result"]).name)


async def _state(row: Row, system: System) -> None:
    """Fill in the vehicle's state as it tells it now."""
    telemetry = TelemetryAsync(system)
    for ask in (telemetry.set_rate_position, telemetry.set_rate_battery):
        with contextlib.suppress(MavsdkError):  # ArduPilot sends them only when asked
            await ask(_RATE)
    armed, mode, position, battery = await asyncio.gather(
        _first(telemetry.subscribe_armed()),
        _first(telemetry.subscribe_flight_mode()),
        _first(telemetry.subscribe_position()),
        _first(telemetry.subscribe_battery()),
    )
    row.armed = armed
    row.mode = getattr(mode, "name", "").lower()
    row.height = round(position.relative_altitude_m, 1) if position is not None else None
    row.battery_percent = round(battery.remaining_percent) if battery is not None else None


async def _first(stream: AsyncIterator[_Value]) -> _Value | None:
    """Return the first value of a stream; None where the stream stays silent."""
    try:
        return await asyncio.wait_for(anext(stream), _FIRST)
    except (TimeoutError, StopAsyncIteration):
        return None
