"""What a Betaflight SITL expects of its simulator, which differs with its version.

Up to MSP API 1.47 (4.6, 2025.12) it is written for the older simulators, from 1.48 (2026.6) for
Gazebo's plugin. Source: platform/SIMULATOR/sitl.c and sitl_gyro.h of each.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mavlink_bridge.shared.frames import flu_frd, quaternion_enu_ned
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import LocalFrame

_MOTION_PACKET = struct.Struct("<d3d3d4d3d3dd")
# Betaflight scales its clock by time stamps against arrivals: on a loaded machine jitter would make
# that clock race and its receiver time out. Constant stamps leave it at real time.
_NO_TIME = 0.0


@dataclass(frozen=True)
class SimulatorLink:
    """One version's link.

    motor_order: indices of motors 1…4 in its packet. gazebo: it takes motion as Gazebo's plugin
    sends it: the yaw rate with the other sign, and the attitude in a frame of west, north and
    down. settings: CLI lines that this version needs besides.
    """

    motor_order: tuple[int, ...]
    gazebo: bool
    settings: tuple[str, ...] = ()

    def motion_packet(self, i: int, state: State, frame: LocalFrame) -> bytes:
        """Encode the motion of vehicle i.

        Rates FRD [rad/s], the yaw rate with the link's sign; specific force FLU with its sign
        changed [m/s²]; attitude of the FRD body; velocity ENU [m/s]; longitude and latitude [deg],
        altitude [m]; pressure [Pa].
        """
        roll, pitch, yaw = flu_frd(*(float(a) for a in state.omega[i]))
        force = -state.specific_force[i]
        q = frame.attitude(state.q[i])
        if self.gazebo:
            yaw = -yaw
            w, x, y, z = (float(k) for k in q)
            attitude = (-z, -y, -x, -w)
        else:
            attitude = quaternion_enu_ned(q)
        latitude, longitude, altitude = frame.to_geo(state.p[i])
        v = frame.vector(state.v[i])
        pressure = 101325.0 * (1.0 - 2.25577e-5 * altitude) ** 5.25588
        motion = (roll, pitch, yaw, *force, *attitude)
        place = (*v, longitude, latitude, altitude)
        return _MOTION_PACKET.pack(_NO_TIME, *motion, *place, pressure)


# The newer one's GPS moves against the vehicle, as Gazebo's world is turned: off, so that the
# bridge flies by GPS_INPUT with either version. Its sticks would come by UDP, not from the bridge.
# It works its attitude out from gyro, accelerometer and a compass of 2° declination.
_OLDER = SimulatorLink((3, 0, 1, 2), gazebo=False)
_NEWER = SimulatorLink(
    (0, 1, 2, 3),
    gazebo=True,
    settings=(
        "feature -GPS",
        "feature -RX_UDP",
        "feature RX_MSP",
        "set mag_hardware = AUTO",
        "set trust_mag = ON",
        "set mag_declination = 20",
    ),
)
_FIRST_NEWER = (1, 48)


def simulator_link(api: tuple[int, int]) -> SimulatorLink:
    """Return the link of a Betaflight with this MSP API."""
    return _NEWER if api >= _FIRST_NEWER else _OLDER
