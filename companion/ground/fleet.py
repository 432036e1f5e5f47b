"""Actions on many vehicles from a ground station, by MAVSDK; never setpoints.

MAVSDK's offboard plugin is not used even for the change of mode: it would send setpoints of its
own, from a thread that goes on while everything else hangs.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Awaitable, Sequence
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
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from companion.settings.config import CompanionConfig
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.link import EndpointError
from mavlink_bridge.wire.messages import Command

_TELL = 2.0  # s for the first word of each telemetry stream
_RATE = 2.0  # Hz
_ACCEPTED = 0
_URLS = (
    "valid: udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT, "
    "serial://DEVICE:BAUD; no other program may hold it"
)
_Value = TypeVar("_Value")


@dataclass
class Row:
    """What came of it for one vehicle, and its state after."""

    drone: str
    system: int
    result: str = "not found"
    ok: bool = False
    armed: bool | None = None
    mode: str = ""
    height: float | None = None
    battery_percent: float | None = None


async def act(
    action: str, drones: Sequence[CompanionConfig], url: str, patience: float
) -> list[Row]:
    """Do `action` with every drone as soon as it is heard; a row each.

    None waits for another: who is to hold or to land may be about to collide.

    url: where the vehicles speak to ground stations, as MAVSDK writes it. patience [s]: for
    vehicles to appear.

    Raises:
        EndpointError: nobody can be heard there; names the URL.
    """
    log_subscribe(lambda *line: True)  # handled: MAVSDK would print each vehicle it meets
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
    """The vehicle of this system id; None where it does not appear in time."""
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
        await _do(action, drone, system)
        row.ok, row.result = True, "done"
    except (MavsdkError, RuntimeError) as error:
        row.result = str(error)
    await _state(row, system)
    return row


async def _do(action: str, drone: CompanionConfig, system: System) -> None:
    """One action with one vehicle; raises where the vehicle refuses."""
    actions = ActionAsync(system)
    if action == "arm":
        await actions.arm()
    elif action == "takeoff":
        if adapter(drone.link.autopilot, drone.link.system_id).mode_after_takeoff == "offboard":
            await _set_offboard(drone, system)  # ArduPilot takes off in guided mode alone
        await actions.set_takeoff_altitude(drone.mission.takeoff_altitude)
        await actions.takeoff()
    elif action == "start":
        await _set_offboard(drone, system)
    elif action == "hold":
        await actions.hold()
    elif action == "land":
        await actions.land()


async def _set_offboard(drone: CompanionConfig, system: System) -> None:
    """Let the companion fly: the mode alone; the setpoints are its own and already there."""
    direct = MavlinkDirectAsync(system)
    for request in adapter(drone.link.autopilot, drone.link.system_id).offboard():
        if not isinstance(request, Command):
            continue
        fields: dict[str, Any] = {f"param{n}": p for n, p in enumerate(request.params, start=1)}
        fields |= {"target_system": request.target_system, "command": request.command,
                   "target_component": request.target_component, "confirmation": 0}  # fmt: skip
        message = MavlinkMessage("COMMAND_LONG", 255, 190, request.target_system, 1,
                                 json.dumps(fields))  # fmt: skip
        ack = json.loads((await direct.send_command(message)).fields_json)
        if ack["result"] != _ACCEPTED:
            raise RuntimeError(f"offboard refused (MAV_RESULT {ack['result']}): is its companion "
                               "running, and streaming?")  # fmt: skip


async def _state(row: Row, system: System) -> None:
    """What the vehicle says of itself now."""
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
    """The first value of a stream; None where it stays silent."""
    try:
        return await asyncio.wait_for(anext(stream), _TELL)
    except (TimeoutError, StopAsyncIteration):
        return None
