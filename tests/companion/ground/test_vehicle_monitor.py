"""What counts as done: two heartbeats in a row, not an acknowledgement."""

import asyncio
import json
from types import SimpleNamespace

import pytest
from mavsdk.plugins.telemetry import LandedState

from companion.ground import fleet, vehicle_monitor
from companion.ground.vehicle_monitor import VehicleMonitor
from companion.settings.config import CompanionConfig
from mavlink_bridge.autopilots.px4 import MODES, Px4

ARMED = 128


def heartbeat(mode, armed=True, component=1):
    fields = {
        "autopilot": 12,
        "type": 2,
        "base_mode": ARMED if armed else 0,
        "custom_mode": MODES[mode],
        "system_status": 4,
    }
    return SimpleNamespace(component_id=component, fields_json=json.dumps(fields))


class Stream:
    """Messages of MAVSDK: some at once, then silence."""

    def __init__(self, messages=()):
        self.messages = list(messages)

    async def __call__(self, *name):
        for message in self.messages:
            await asyncio.sleep(0.001)
            yield message
        await asyncio.Event().wait()


@pytest.fixture
def monitor(monkeypatch):
    """A monitor of a vehicle that tells what it is given."""

    def made(heartbeats=(), landed=(), texts=()):
        direct = SimpleNamespace(subscribe_message=Stream(heartbeats))

        async def set_rate(hz):
            pass

        telemetry = SimpleNamespace(
            subscribe_landed_state=Stream(landed),
            subscribe_status_text=Stream(SimpleNamespace(text=t) for t in texts),
            set_rate_landed_state=set_rate,
        )
        monkeypatch.setattr(vehicle_monitor, "MavlinkDirectAsync", lambda system: direct)
        monkeypatch.setattr(vehicle_monitor, "TelemetryAsync", lambda system: telemetry)
        return VehicleMonitor(None, Px4(1))

    return made


async def shown(monitor, action):
    async with monitor:
        return await monitor.shows(fleet.SHOWN[action].by, 0.2)


@pytest.mark.parametrize(
    ("action", "heartbeats", "landed", "done"),
    [
        ("arm", [heartbeat("hold", armed=False), heartbeat("hold"), heartbeat("hold")], [], True),
        ("arm", [heartbeat("hold", armed=False)] * 5, [], False),
        ("start", [heartbeat("offboard")] * 2, [], True),
        ("start", [heartbeat("offboard"), heartbeat("hold")] * 4, [], False),  # left again
        ("start", [heartbeat("offboard", component=191)] * 5, [], False),  # not the autopilot
        ("takeoff", [heartbeat("takeoff")] * 9, [LandedState.TAKING_OFF], True),
        ("takeoff", [heartbeat("takeoff")] * 9, [LandedState.ON_GROUND], False),
        ("hold", [heartbeat("hold")] * 2, [], True),
        ("land", [heartbeat("land")] * 2, [], True),
        ("land", [heartbeat("hold", armed=False)] * 2, [], True),
        ("land", [], [], False),
    ],
)
def test_what_a_vehicle_must_show(monitor, action, heartbeats, landed, done):
    assert asyncio.run(shown(monitor(heartbeats, landed), action)) is done


def test_the_vehicles_words_are_part_of_the_result(monitor, monkeypatch):
    async def do(action, drone, system):
        pass  # acknowledged

    async def tried():
        texts = ["Preflight: compass", "Offboard refused: no setpoints"]
        async with monitor([heartbeat("hold")] * 3, texts=texts) as following:
            return await fleet._try("start", CompanionConfig(), None, following)

    monkeypatch.setattr(fleet, "_do", do)
    start = fleet.SHOWN["start"]
    monkeypatch.setitem(fleet.SHOWN, "start", fleet.Shown(start.what, start.by, 0.1))
    assert asyncio.run(tried()) == (
        "accepted, but not in offboard (is its companion running, and streaming?) within 0.1 s: "
        "armed, mode hold; it says: Preflight: compass; Offboard refused: no setpoints"
    )


def test_a_refusal_waits_for_the_words_that_follow_it(monitor, monkeypatch):
    async def do(action, drone, system):
        raise fleet.Refused("TEMPORARILY_REJECTED")

    async def tried():
        async with monitor([heartbeat("hold", armed=False)], texts=["Not now"]) as following:
            return await fleet._try("hold", CompanionConfig(), None, following)

    monkeypatch.setattr(fleet, "_do", do)
    monkeypatch.setattr(fleet, "_WORDS", 0.05)
    assert asyncio.run(tried()) == (
        "refused (TEMPORARILY_REJECTED): disarmed, mode hold; it says: Not now"
    )


def test_looking_needs_no_heartbeat(monitor):
    async def tried():
        async with monitor() as following:
            return await fleet._try("status", CompanionConfig(), None, following)

    assert asyncio.run(tried()) == ""
