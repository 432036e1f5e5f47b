"""The autopilot's inner loop at 1 kHz: rate PID with Betaflight's structure, and the mixer.

Feed-forward from the filtered setpoint, D on the low-passed gyro, relaxed and bounded I, air mode,
desaturation, thrust linearisation, motor idle. Gains are in SI, so that one set fits every
airframe: the controller computes angular acceleration [rad/s²], the mixer has inertia and levers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.rigid_body import MOTOR_SPIN, MOTOR_X, MOTOR_Y, SUBSTEP

Floats = NDArray[np.float64]

I_LIMIT = 60.0  # rad/s², limit of the I term
RELAX_RATE = 0.7  # rad/s (40°/s); a setpoint that moves faster than this freezes the I term
YAW_SHARE = 0.3  # share of the motors' range that yaw may take when roll and pitch need it


class RateLoop(NamedTuple):
    """Gains and states of the rate loops of n vehicles.

    gains (n,4,3): P, I, D, feed-forward by axis. smoothing (n,4): per-step factors of the
    low-passes of setpoint, gyro, D and relax. share (n,3): share of a motor's thrust for 1 rad/s²
    of roll, pitch, yaw. curve (n,): 1 where thrust goes with the square of the motor command, 0
    where in proportion. idle (n,). boost (n,): compensation of a low battery. setpoint, slow,
    gyro, slope, integral (n,3): filter states. command (n,4): motor commands 0…1.
    """

    gains: Floats
    smoothing: Floats
    share: Floats
    curve: Floats
    idle: Floats
    boost: Floats
    setpoint: Floats
    slow: Floats
    gyro: Floats
    slope: Floats
    integral: Floats
    command: Floats


def make_rate_loop(gains: list[RateGains], airframes: list[Airframe]) -> RateLoop:
    """Return rate loops at rest, one for each set of gains and airframe."""
    n = len(gains)
    cutoffs = np.array([[g.setpoint_hz, g.gyro_hz, g.d_hz, g.relax_hz] for g in gains])
    levers = [
        [a.arm * math.sqrt(0.5), a.arm * math.sqrt(0.5), a.torque_coefficient] for a in airframes
    ]
    full = np.array([4.0 * a.thrust_max for a in airframes])[:, None]
    return RateLoop(
        gains=np.array([[g.p, g.i, g.d, g.feed_forward] for g in gains]).reshape(n, 4, 3),
        smoothing=1.0 - np.exp(-2 * math.pi * SUBSTEP * cutoffs.reshape(n, 4)),
        share=np.array([a.inertia for a in airframes]) / (full * np.array(levers)),
        curve=np.ones(n),
        idle=np.array([a.idle for a in airframes]),
        boost=np.ones(n),
        setpoint=np.zeros((n, 3)),
        slow=np.zeros((n, 3)),
        gyro=np.zeros((n, 3)),
        slope=np.zeros((n, 3)),
        integral=np.zeros((n, 3)),
        command=np.zeros((n, 4)),
    )


@njit(cache=True)
def reset_rates(i: int, loop: RateLoop) -> None:
    """Reset setpoint and integral of vehicle i (on the ground with motors at idle)."""
    loop.setpoint[i] = 0.0
    loop.slow[i] = 0.0
    loop.integral[i] = 0.0


@njit(cache=True)
def rate_loop(
    i: int, loop: RateLoop, omega_sp: Floats, thrust: float, gyro: Floats, dt: float
) -> None:
    """Compute loop.command[i] from body rates omega_sp (3,) rad/s and thrust 0…1.

    gyro: (3,) rad/s, measured.
    """
    a_sp, a_gyro, a_d, a_relax = loop.smoothing[i]
    gains = loop.gains[i]
    ask0 = ask1 = ask2 = 0.0
    for k in range(3):
        before = loop.setpoint[i, k]
        loop.setpoint[i, k] += a_sp * (omega_sp[k] - before)
        setpoint = loop.setpoint[i, k]
        last = loop.gyro[i, k]
        loop.gyro[i, k] += a_gyro * (gyro[k] - last)
        rate = loop.gyro[i, k]
        loop.slope[i, k] += a_d * ((rate - last) / dt - loop.slope[i, k])

        # I-term relax: while the setpoint moves, the error is the loop's lag and not a bias.
        loop.slow[i, k] += a_relax * (setpoint - loop.slow[i, k])
        relax = max(0.0, 1.0 - abs(setpoint - loop.slow[i, k]) / RELAX_RATE)
        error = setpoint - rate
        integral = loop.integral[i, k] + gains[1, k] * relax * error * dt
        loop.integral[i, k] = min(max(integral, -I_LIMIT), I_LIMIT)

        ask = (
            gains[0, k] * error
            + loop.integral[i, k]
            - gains[2, k] * loop.slope[i, k]
            + gains[3, k] * (setpoint - before) / dt
        )
        if k == 0:
            ask0 = ask
        elif k == 1:
            ask1 = ask
        else:
            ask2 = ask
    mix(i, loop, ask0, ask1, ask2, thrust)


@njit(cache=True)
def mix(i: int, loop: RateLoop, roll: float, pitch: float, yaw: float, thrust: float) -> None:
    """Compute the motor commands of vehicle i from angular accelerations [rad/s²] and thrust 0…1.

    Where the motors saturate, these are reduced in order: yaw beyond its share; thrust (air mode:
    it is shifted so that attitude control remains); then roll and pitch in proportion.
    """
    roll *= loop.share[i, 0]
    pitch *= loop.share[i, 1]
    yaw *= loop.share[i, 2]
    room = max(YAW_SHARE, 1.0 - 2.0 * (abs(roll) + abs(pitch)))
    yaw = min(max(yaw, -0.5 * room), 0.5 * room)

    low, high = 1.0, -1.0
    for k in range(4):
        share = MOTOR_Y[k] * roll - MOTOR_X[k] * pitch + MOTOR_SPIN[k] * yaw
        loop.command[i, k] = share
        low, high = min(low, share), max(high, share)
    scale = 1.0 / (high - low) if high - low > 1.0 else 1.0
    base = min(max(thrust, -low * scale), 1.0 - high * scale)
    for k in range(4):
        share = min(max(base + loop.command[i, k] * scale, 0.0), 1.0)
        # Invert share = curve·u² + (1 - curve)·u, and never stop a motor in flight.
        curve = loop.curve[i]
        if curve > 0.0:
            linear = 1.0 - curve
            share = (math.sqrt(linear * linear + 4.0 * curve * share) - linear) / (2.0 * curve)
        loop.command[i, k] = min(max(share * loop.boost[i], loop.idle[i]), 1.0)
