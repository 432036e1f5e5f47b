"""A user's script for mavsdk-grpc: connect, arm, take off, body rates, hold, land.

Usage: fly_grpc.py {px4|ardupilot} GRPC_PORT URL. One JSON object on stdout.
"""

import asyncio
import json
import sys

from mavsdk_grpc import System
from mavsdk_grpc.offboard import AttitudeRate

HOLDS = {"px4": 0.333, "ardupilot": 0.5}  # thrust, or ArduPilot's climb rate 0
PATIENCE = 90.0  # s; a client's own time-out, never a measurement


async def first(stream, condition):
    """The first value of a stream that satisfies the condition."""

    async def search():
        async for value in stream:
            if condition(value):
                return value
        return None

    return await asyncio.wait_for(search(), PATIENCE)


async def main(flavour, port, url):
    measured = {}
    drone = System(port=int(port))
    await drone.connect(system_address=url)
    await first(drone.core.connection_state(), lambda s: s.is_connected)
    for name in ("position", "health", "in_air", "velocity_ned"):
        await getattr(drone.telemetry, f"set_rate_{name}")(10.0)
    await first(drone.telemetry.health(), lambda h: h.is_armable and h.is_global_position_ok)

    await drone.action.set_takeoff_altitude(5.0)
    await drone.action.arm()
    await drone.action.takeoff()
    await first(drone.telemetry.position(), lambda p: p.relative_altitude_m > 4.5)
    await first(drone.telemetry.velocity_ned(), lambda v: abs(v.down_m_s) < 0.1)
    await asyncio.sleep(3.0)
    height = (await anext(drone.telemetry.position())).relative_altitude_m
    measured["takeoff_height"] = height

    rates = AttitudeRate(0.0, 0.0, 20.0, HOLDS[flavour])
    await drone.offboard.set_attitude_rate(rates)
    await drone.offboard.start()
    await asyncio.sleep(3.0)
    measured["offboard_active"] = await drone.offboard.is_active()
    await drone.offboard.stop()
    await drone.action.hold()

    await drone.action.land()
    await first(drone.telemetry.in_air(), lambda flying: not flying)
    await first(drone.telemetry.armed(), lambda armed: not armed)
    measured["disarmed"] = True
    print(json.dumps(measured), flush=True)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
