"""A user's MAVSDK script: fly every vehicle behind the given URLs, and print measurements.

Usage: fly_mavsdk.py {px4|ardupilot} {all|quick} URL… One JSON object per vehicle on stdout.
"""

import asyncio
import json
import math
import sys
import time

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.offboard import AttitudeRate

PATIENCE = 90.0  # s; a client's own time-out, never a measurement
ALTITUDE = 5.0
OFFBOARD_SECONDS = 10.0
YAW_RATE = 20.0  # °/s


class Vehicle:
    """One vehicle, with the plugins that a flight needs and its latest telemetry."""

    def __init__(self, system, flavour):
        self.flavour = flavour
        self.action, self.offboard = ActionAsync(system), OffboardAsync(system)
        self.telemetry, self.param = TelemetryAsync(system), ParamAsync(system)
        self.mission = MissionRawAsync(system)
        self.latest = {}
        self.measured = {}
        self._listeners = []

    async def listen(self):
        """Subscribe to the telemetry that the flight uses, at its rates."""
        rates = {"position": 20, "attitude_euler": 20, "velocity_ned": 20, "health": 2, "in_air": 5}
        for name, rate in rates.items():
            await getattr(self.telemetry, f"set_rate_{name}")(float(rate))
        for name in (
            "position",
            "attitude_euler",
            "velocity_ned",
            "armed",
            "in_air",
            "health",
            "flight_mode",
            "status_text",
        ):
            self._listeners.append(asyncio.create_task(self._keep(name)))

    async def _keep(self, name):
        async for value in getattr(self.telemetry, f"subscribe_{name}")():
            self.latest[name] = value

    async def until(self, what, condition):
        """Wait for a condition on telemetry."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                if condition(self.latest):
                    return
            except KeyError:
                pass  # that stream has not spoken yet
            if time.monotonic() > end:
                raise TimeoutError(
                    f"{what}; last heard: { {k: str(v) for k, v in self.latest.items()} }"
                )
            await asyncio.sleep(0.05)

    @property
    def height(self):
        return self.latest["position"].relative_altitude_m

    def stop(self):
        for listener in self._listeners:
            listener.cancel()


async def health(v):
    names = (
        "gyrometer_calibration",
        "accelerometer_calibration",
        "magnetometer_calibration",
        "local_position",
        "global_position",
        "home_position",
    )
    checks = [*(f"is_{n}_ok" for n in names), "is_armable"]
    await v.until("health", lambda t: all(getattr(t["health"], c) for c in checks))
    v.measured["health"] = len(checks)


async def parameters(v):
    everything = await v.param.get_all_params()
    v.measured["parameters"] = len(everything.int_params) + len(everything.float_params)
    whole, real, value = {
        "px4": ("COM_OBL_RC_ACT", "RTL_RETURN_ALT", 5),
        "ardupilot": ("GUID_OPTIONS", "RTL_ALT", 8),
    }[v.flavour]
    ints = {p.name: p.value for p in everything.int_params}
    v.measured["int_before"] = ints[whole]
    await v.param.set_param_int(whole, value)
    v.measured["int_after"] = await v.param.get_param_int(whole)
    if v.flavour == "px4":
        await v.param.set_param_float(real, 12.5)
        v.measured["float_after"] = await v.param.get_param_float(real)
        v.measured["hover"] = await v.param.get_param_float("MPC_THR_HOVER")
    else:
        v.measured["hover"] = await v.param.get_param_float("MOT_THST_HOVER")


async def take_off(v):
    await v.action.set_takeoff_altitude(ALTITUDE)
    await v.action.arm()
    await v.until("armed", lambda t: t["armed"])
    await v.action.takeoff()
    await v.until("in air", lambda t: t["in_air"])
    await v.until("up", lambda t: t["position"].relative_altitude_m > ALTITUDE - 0.5)
    await v.until("at rest", lambda t: abs(t["velocity_ned"].down_m_s) < 0.1)
    await asyncio.sleep(3.0)
    v.measured["takeoff_height"] = v.height


async def body_rates(v):
    """Turn at a constant yaw rate for ten seconds; level and at one height by feedback."""
    height, hover = v.height, v.measured["hover"]

    def setpoint():
        e, velocity = v.latest["attitude_euler"], v.latest["velocity_ned"]
        lift = 0.05 * (height - v.height) + 0.08 * velocity.down_m_s
        return AttitudeRate(-2.0 * e.roll_deg, -2.0 * e.pitch_deg, YAW_RATE, hover * (1 + lift))

    await v.offboard.set_attitude_rate(setpoint())
    await v.offboard.start()
    last, turned, lowest, highest = v.latest["attitude_euler"].yaw_deg, 0.0, height, height
    end, modes = time.monotonic() + OFFBOARD_SECONDS, set()
    while time.monotonic() < end:
        await v.offboard.set_attitude_rate(setpoint())
        await asyncio.sleep(0.05)
        yaw = v.latest["attitude_euler"].yaw_deg
        modes.add(v.latest["flight_mode"].name)
        turned += (yaw - last + 180.0) % 360.0 - 180.0
        last = yaw
        lowest, highest = min(lowest, v.height), max(highest, v.height)
    v.measured["offboard_active"] = await v.offboard.is_active()
    v.measured["modes"] = sorted(modes)
    v.measured["turned"], v.measured["height_span"] = turned, highest - lowest
    await v.offboard.stop()
    await v.action.hold()


async def fly_mission(v):
    """Three points around the place, uploaded, read back, flown; the nearest passes measured."""
    here = v.latest["position"]
    north = 1 / 111_320.0
    east = north / math.cos(math.radians(here.latitude_deg))
    points = [
        (here.latitude_deg + n * north, here.longitude_deg + e * east)
        for n, e in ((8.0, 0.0), (8.0, 8.0), (0.0, 0.0))
    ]
    items = [
        MissionItem(
            k,
            6,
            16,
            int(k == 0),
            1,
            0.0,
            1.0,
            0.0,
            math.nan,
            round(lat * 1e7),
            round(lon * 1e7),
            ALTITUDE,
            0,
        )
        for k, (lat, lon) in enumerate(points)
    ]
    if v.flavour == "ardupilot":  # keeps home as item 0
        home = MissionItem(0, 0, 16, 1, 1, 0.0, 0.0, 0.0, math.nan, items[2].x, items[2].y, 0.0, 0)
        for item in items:
            item.seq, item.current = item.seq + 1, 0
        items.insert(0, home)
    await v.mission.upload_mission(items)
    v.measured["mission_items"] = len(await v.mission.download_mission())
    await v.mission.start_mission()
    nearest = [math.inf] * len(points)
    end = time.monotonic() + PATIENCE
    while max(nearest) > 1.5 and time.monotonic() < end:
        p = v.latest["position"]
        for k, (lat, lon) in enumerate(points):
            if k > 0 and nearest[k - 1] > 1.5:
                break  # in order
            d = math.hypot((p.latitude_deg - lat) / north, (p.longitude_deg - lon) / east)
            nearest[k] = min(nearest[k], d)
        await asyncio.sleep(0.05)
    v.measured["mission_nearest"] = nearest
    await v.action.hold()


async def land(v):
    await v.action.land()
    await v.until("landed", lambda t: not t["in_air"])
    await v.until("disarmed", lambda t: not t["armed"])
    v.measured["landed_height"] = v.height


async def fly(system, flavour, extent):
    v = Vehicle(system, flavour)
    await v.listen()
    await health(v)
    await parameters(v)
    await take_off(v)
    await body_rates(v)
    if extent == "all":
        await fly_mission(v)
    await land(v)
    v.stop()
    return {"system": await system.get_system_id(), **v.measured}


async def main(flavour, extent, urls):
    config = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(config) as mavsdk:
        for url in urls:
            await mavsdk.add_any_connection(url)
        expected = len(urls)
        end = time.monotonic() + PATIENCE
        while True:
            systems = [s for s in await mavsdk.get_systems() if await s.has_autopilot()]
            if len(systems) >= expected:
                break
            if time.monotonic() > end:
                raise TimeoutError(f"{len(systems)} of {expected} vehicles found")
            await asyncio.sleep(0.1)
        for flown in await asyncio.gather(*(fly(s, flavour, extent) for s in systems)):
            print(json.dumps(flown), flush=True)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2], sys.argv[3:]))
