"""ENU/NED, FLU/FRD and quaternions; no other file knows NED or multiplies quaternions.

| frame | axes | where |
|---|---|---|
| world W | ENU: x east, y north, z up | everywhere inside |
| body B | FLU: x forward, y left, z up | everywhere inside |
| NED / FRD | north-east-down / forward-right-down | on the wire only |

Quaternions are Hamilton, (w, x, y, z), and rotate body vectors into the world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mavlink_bridge.shared.arrays import Vector, norm

_S = math.sqrt(0.5)


def _floats(v: Sequence[float] | Vector) -> list[float]:
    """Return the elements as numbers of Python, with which few are reckoned fastest."""
    return v.tolist() if isinstance(v, np.ndarray) else [float(a) for a in v]


def enu_ned(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert ENU to NED or NED to ENU; the map is its own inverse."""
    return y, x, -z


def flu_frd(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert FLU to FRD or FRD to FLU; the map is its own inverse."""
    return x, -y, -z


def quaternion_enu_ned(q: Sequence[float] | Vector) -> tuple[float, float, float, float]:
    """Convert an attitude (w, x, y, z) FLU→ENU to FRD→NED or back; the map is its own inverse.

    q_T ⊗ q ⊗ q_S with q_T = (0, √½, √½, 0) and q_S = (0, 1, 0, 0), written out.
    """
    w, x, y, z = _floats(q)
    return _S * (w + z), _S * (x + y), _S * (x - y), _S * (w - z)


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Vector:
    """Return the quaternion (4,) of intrinsic z-y-x angles [rad], in the frame of the angles."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def euler_from_quaternion(q: Sequence[float] | Vector) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] (intrinsic z-y-x) of a unit quaternion (w, x, y, z)."""
    w, x, y, z = _floats(q)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def heading_from_yaw(yaw: float) -> float:
    """Return the compass heading [0, 2π), clockwise from north, of an ENU yaw."""
    return (math.pi / 2 - yaw) % (2 * math.pi)


def yaw_from_heading(heading: float) -> float:
    """Return the ENU yaw (−π, π] of a compass heading."""
    yaw = (math.pi / 2 - heading) % (2 * math.pi)
    return yaw - 2 * math.pi if yaw > math.pi else yaw


def multiply(a: Sequence[float] | Vector, b: Sequence[float] | Vector) -> Vector:
    """Return the Hamilton product a ⊗ b of two quaternions (4,)."""
    aw, ax, ay, az = _floats(a)
    bw, bx, by, bz = _floats(b)
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def conjugate(q: Vector) -> Vector:
    """Return the inverse rotation of a unit quaternion (4,)."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


def rotation_matrix(q: Sequence[float] | Vector) -> Vector:
    """Return the (3,3) matrix R with v_W = R v_B of a unit quaternion (w, x, y, z)."""
    w, x, y, z = _floats(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def integrate(q: Vector, omega: Vector, dt: float) -> Vector:
    """Return the attitude after `dt` [s] at constant body rates: q ⊗ exp(ω dt / 2), eq. (3).

    It equals `rotate(q, omega * dt)` up to rounding; replays rely on the last bit of both.
    """
    speed = norm(omega)
    angle = speed * dt
    if abs(angle) < 1e-9:
        return q
    c, s = float(np.cos(angle / 2)), float(np.sin(angle / 2))
    rotated = multiply(q, [c, *(s * (rate / speed) for rate in omega.tolist())])
    return rotated / norm(rotated)


def rotate(q: Vector, rotation: Vector) -> Vector:
    """Return q ⊗ exp(rotation / 2) for a rotation vector (3,) [rad] in the body frame of q."""
    angle = norm(rotation)
    if angle < 1e-9:
        return q
    s = math.sin(angle / 2) / angle
    rotated = multiply(q, [math.cos(angle / 2), *(s * a for a in rotation.tolist())])
    return rotated / norm(rotated)


def rotation_vector(q: Vector) -> Vector:
    """Return the rotation vector (3,) [rad], at most π long, of a unit quaternion (4,)."""
    if q[0] < 0.0:
        q = -q
    size = norm(q[1:])
    if size < 1e-9:
        return np.zeros(3)
    return 2.0 * math.atan2(size, float(q[0])) / size * q[1:]
