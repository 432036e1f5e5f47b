"""What a vehicle tells a ground station of itself: HEARTBEAT, landed state, STATUSTEXT."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Coroutine
from typing import Any, Self

from mavsdk.asyncio import System
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.telemetry import LandedState

from mavlink_bridge.autopilots.registry import Autopilot
from mavlink_bridge.wire.messages import Heartbeat

_AUTOPILOT = 1  # component id
_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_LANDED_RATE = 2.0  # Hz
_IN_A_ROW = 2  # heartbeats; PX4 leaves a mode again that it should not have entered


class VehicleMonitor:
    """Follows one vehicle from `async with` on.

    armed: None before the first heartbeat. mode: as the autopilot's adapter names it. texts: all
    STATUSTEXTs so far.
    """

    def __init__(self, system: System, autopilot: Autopilot) -> None:
        self.armed: bool | None = None
        self.mode = ""
        self.landed = LandedState.UNKNOWN
        self.texts: list[str] = []
        self._direct = MavlinkDirectAsync(system)
        self._telemetry = TelemetryAsync(system)
        self._autopilot = autopilot
        self._heartbeat = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        follow: list[Coroutine[Any, Any, None]] = [
            self._follow_heartbeat(),
            self._follow_landed_state(),
            self._follow_texts(),
        ]
        self._tasks = [asyncio.create_task(f) for f in follow]
        await asyncio.sleep(0)  # let each subscribe
        return self

    async def __aexit__(self, *exception: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def in_air(self) -> bool:
        """Whether the vehicle says that it is off the ground."""
        return self.landed in (LandedState.TAKING_OFF, LandedState.IN_AIR, LandedState.LANDING)

    async def shows(self, wanted: Callable[[VehicleMonitor], bool], seconds: float) -> bool:
        """Return whether `wanted` comes to hold within so many seconds, two heartbeats in a row."""
        held = 0
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while held < _IN_A_ROW:
                    self._heartbeat.clear()
                    await self._heartbeat.wait()
                    held = held + 1 if wanted(self) else 0
        return held >= _IN_A_ROW

    def state(self) -> str:
        """Return the state and the vehicle's own words, for a message."""
        armed = {True: "armed", False: "disarmed", None: "no heartbeat"}[self.armed]
        said = f"; it says: {'; '.join(self.texts)}" if self.texts else ""
        return f"{armed}, mode {self.mode or 'unknown'}{said}"

    async def _follow_heartbeat(self) -> None:
        async with contextlib.aclosing(self._direct.subscribe_message("HEARTBEAT")) as messages:
            async for message in messages:
                if message.component_id != _AUTOPILOT:
                    continue
                fields = json.loads(message.fields_json)
                self.armed = bool(fields["base_mode"] & _ARMED)
                self.mode = self._autopilot.mode(
                    Heartbeat(
                        autopilot=fields["autopilot"],
                        vehicle_type=fields["type"],
                        armed=self.armed,
                        custom_mode=fields["custom_mode"],
                        system_status=fields["system_status"],
                    )
                )
                self._heartbeat.set()

    async def _follow_landed_state(self) -> None:
        async with contextlib.aclosing(self._telemetry.subscribe_landed_state()) as states:
            with contextlib.suppress(MavsdkError):  # ArduPilot sends it only when asked
                await self._telemetry.set_rate_landed_state(_LANDED_RATE)
            async for state in states:
                self.landed = state

    async def _follow_texts(self) -> None:
        async with contextlib.aclosing(self._telemetry.subscribe_status_text()) as texts:
            async for text in texts:
                self.texts.append(text.text)
