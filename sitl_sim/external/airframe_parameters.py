"""Autopilot parameters that say what the simulator's airframe is, as its builder would set them.

A real autopilot boots for some other airframe: with a wrong thrust curve its hover thrust is
wrong, with wrong gains it swings. Nothing here makes an autopilot behave otherwise than on such a
drone.
"""

from __future__ import annotations

import math

from sitl_sim.vehicles.airframe import Airframe

# Parameters of rate loops go with the angular acceleration that a full command gives.
_PX4_IRIS = (149.0, 0.15, 0.2, 0.003)  # rad/s² in roll and pitch; its P, I and D
_PX4_ALLOCATION = 2.83  # motors' thrust in roll and pitch for a full command, of one motor's


def px4_parameters(airframe: Airframe) -> dict[str, float]:
    """Return PX4's parameters for the airframe."""
    lever = airframe.arm * math.sqrt(0.5)
    out = {
        "THR_MDL_FAC": 1.0,  # force goes with the square of the motor command
        "MPC_THR_HOVER": round(airframe.hover_thrust, 4),
        "IMU_GYRO_FFT_EN": 0.0,  # searches for vibrations, which the physics has not
        "SDLOG_PROFILE": 1.0,  # the usual log: SITL's own choice writes 1 MB/s
    }
    rotors = ((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))  # forward, right, turning left
    for k, (x, y, spin) in enumerate(rotors):
        out[f"CA_ROTOR{k}_PX"] = round(x * lever, 4)
        out[f"CA_ROTOR{k}_PY"] = round(y * lever, 4)
        out[f"CA_ROTOR{k}_KM"] = spin * airframe.torque_coefficient
    own, p, i, d = _PX4_IRIS
    for axis, inertia in zip(("ROLL", "PITCH"), airframe.inertia, strict=False):
        share = own * inertia / (_PX4_ALLOCATION * airframe.thrust_max * lever)
        for letter, gain in (("P", p), ("I", i), ("D", d)):
            out[f"MC_{axis}RATE_{letter}"] = round(gain * share, 5)
    return out


# Of the air at the geodetic reference, 488 m, to that at sea level: ArduCopter gives more thrust in
# thinner air, and the physics has one air.
_DENSITY = 0.954


def ardupilot_parameters(airframe: Airframe) -> dict[str, float]:
    """Return ArduCopter's parameters for the airframe."""
    low = airframe.idle
    hover = _DENSITY * ((math.sqrt(airframe.hover_thrust) - low) / (1.0 - low)) ** 2
    return {
        "FRAME_CLASS": 1.0,  # quadrotor
        "FRAME_TYPE": 1.0,  # X
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
        "MOT_THST_EXPO": 1.0,  # force goes with the square of the motor command
        "MOT_THST_HOVER": round(hover, 4),
        "MOT_SPIN_ARM": low,
        "MOT_SPIN_MIN": low,
        "MOT_SPIN_MAX": 1.0,
        "ATC_ANGLE_BOOST": 0.0,  # thrust is the body's own: no more of it where the drone leans
        # What ArduPilot's initial parameters are for propellers of 5 inches: Hz, 0.01 °/s².
        "INS_GYRO_FILTER": 75.0,
        "ATC_RAT_RLL_FLTT": 37.0,
        "ATC_RAT_RLL_FLTD": 37.0,
        "ATC_RAT_PIT_FLTT": 37.0,
        "ATC_RAT_PIT_FLTD": 37.0,
        "ATC_ACCEL_R_MAX": 168600.0,
        "ATC_ACCEL_P_MAX": 168600.0,
        # Yaw as fast as the airframe turns: the default takes half a second to 2 rad/s.
        "ATC_ACCEL_Y_MAX": 72000.0,
        "ATC_RAT_YAW_FLTT": 37.0,
        "ATC_RAT_YAW_FLTE": 10.0,
        "ATC_RAT_YAW_P": 0.5,
        "ATC_RAT_YAW_I": 0.05,
        # Rate loops of 32 rad/s in roll and pitch; D makes up for the motors' lag.
        "ATC_RAT_RLL_P": 0.1,
        "ATC_RAT_RLL_I": 0.1,
        "ATC_RAT_RLL_D": 0.003,
        "ATC_RAT_PIT_P": 0.108,
        "ATC_RAT_PIT_I": 0.108,
        "ATC_RAT_PIT_D": 0.0032,
    }
