"""Rigid bodies: eq. (1)-(4) of the paper with motor lag, drag, wind and ground contact.

World ENU, body FLU, SI; quaternions w,x,y,z, body → world. The equations are the
simulator's own and are never shared with the companion's model. Motors are numbered as in
Betaflight: 1 rear right, 2 front right, 3 rear left, 4 front left.

The compiled kernels have their own quaternion product, written out in scalars: numba cannot call
`mavlink_bridge.shared.frames`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mavlink_bridge.shared.constants import GRAVITY
from sitl_sim.vehicles.airframe import Airframe

Floats = NDArray[np.float64]

SUBSTEP = 0.001  # s; one step of the rigid body and of the rate loop

# Signs of each motor's place along x (forward) and y (left), and of the reaction torque about
# +z on the frame: motors 1 and 4 turn clockwise seen from above, so they push the frame left.
MOTOR_X = (-1.0, 1.0, -1.0, 1.0)
MOTOR_Y = (-1.0, -1.0, 1.0, 1.0)
MOTOR_SPIN = (1.0, -1.0, -1.0, 1.0)

FRICTION = 0.7  # between the feet and the ground
GROUND_DAMPING_TIME = 0.02  # s; the feet stop rotation
GROUND_LEVELLING_TIME = 0.1  # s; the feet level the frame


class State(NamedTuple):
    """State of n vehicles, with specific force and ground contact.

    p (n,3) m; v (n,3) m/s; q (n,4) body → world; omega (n,3) rad/s, body; motor (n,4) speed 0…1;
    specific_force (n,3) m/s², body, as an accelerometer measures; contact (n,) with the ground.
    """

    p: Floats
    v: Floats
    q: Floats
    omega: Floats
    motor: Floats
    specific_force: Floats
    contact: NDArray[np.bool_]


class Body(NamedTuple):
    """The airframes as arrays over vehicles, for the kernels; units as in `Airframe`.

    lever (n,): m, of each motor along x and along y. thrust_max (n,4): a weak motor is a smaller
    value. motor_gain (n,): share of its speed that a command reaches (battery voltage). lift (n,):
    factor on thrust, of the ground's cushion. torque (n,3): N m, body, of the air. ground (n,3):
    the plane of the ground near each vehicle, z = a + b·x + c·y.
    """

    mass: Floats
    inertia: Floats
    lever: Floats
    thrust_max: Floats
    motor_time: Floats
    torque_coefficient: Floats
    rotor_torque: Floats
    drag_linear: Floats
    drag_quadratic: Floats
    idle: Floats
    motor_gain: Floats
    lift: Floats
    torque: Floats
    ground: Floats


class Vehicles:
    """All vehicles as arrays; `step` simulates them under given motor commands."""

    def __init__(
        self, airframe: Airframe | Sequence[Airframe], p: ArrayLike, yaw: ArrayLike
    ) -> None:
        """Place vehicles at rest.

        airframe: one for all or one each. p: (n,3) m, world. yaw: (n,) rad, 0 = along +x (east).
        """
        p0 = np.array(p, dtype=np.float64).reshape(-1, 3)
        n = len(p0)
        yaw0 = np.broadcast_to(np.asarray(yaw, dtype=np.float64), (n,))
        frames = [airframe] * n if isinstance(airframe, Airframe) else list(airframe)
        if len(frames) != n:
            raise ValueError(f"{len(frames)} airframes for {n} vehicles: give one, or {n}")
        q0 = np.zeros((n, 4))
        q0[:, 0], q0[:, 3] = np.cos(yaw0 / 2), np.sin(yaw0 / 2)
        self.airframes = frames
        self.t = 0.0
        self.state = State(
            p=p0,
            v=np.zeros((n, 3)),
            q=q0,
            omega=np.zeros((n, 3)),
            motor=np.zeros((n, 4)),
            specific_force=np.tile([0.0, 0.0, GRAVITY], (n, 1)),
            contact=p0[:, 2] <= 0.0,
        )
        self.body = Body(
            mass=np.array([a.mass for a in frames]),
            inertia=np.array([a.inertia for a in frames]).reshape(n, 3),
            lever=np.array([a.arm * math.sqrt(0.5) for a in frames]),
            thrust_max=np.array([[a.thrust_max] * 4 for a in frames]).reshape(n, 4),
            motor_time=np.array([a.motor_time for a in frames]),
            torque_coefficient=np.array([a.torque_coefficient for a in frames]),
            rotor_torque=np.array([a.rotor_torque for a in frames]),
            drag_linear=np.array([a.drag_linear for a in frames]).reshape(n, 3),
            drag_quadratic=np.array([a.drag_quadratic for a in frames]),
            idle=np.array([a.idle for a in frames]),
            motor_gain=np.ones(n),
            lift=np.ones(n),
            torque=np.zeros((n, 3)),
            ground=np.zeros((n, 3)),
        )

    def __len__(self) -> int:
        return len(self.state.p)

    @property
    def p(self) -> Floats:
        """Positions (n,3) m, world."""
        return self.state.p

    @property
    def v(self) -> Floats:
        """Velocities (n,3) m/s, world."""
        return self.state.v

    @property
    def q(self) -> Floats:
        """Attitudes (n,4) w,x,y,z, body → world."""
        return self.state.q

    @property
    def omega(self) -> Floats:
        """Body rates (n,3) rad/s, body."""
        return self.state.omega

    @property
    def motor(self) -> Floats:
        """Motor speeds (n,4), 0…1 of full speed."""
        return self.state.motor

    @property
    def specific_force(self) -> Floats:
        """Specific force as an accelerometer measures it, (n,3) m/s², body."""
        return self.state.specific_force

    def step(self, dt: float, command: Floats, wind: ArrayLike = 0.0, n_substeps: int = 1) -> None:
        """Simulate all vehicles for dt [s] under constant motor commands.

        command: (n,4) normalised motor speeds 0…1. wind: (3,) or (n,3) m/s, world.
        """
        w = np.ascontiguousarray(np.broadcast_to(np.asarray(wind, dtype=np.float64), self.p.shape))
        u = np.ascontiguousarray(command, dtype=np.float64).reshape(-1, 4)
        _step_all(self.state, self.body, u, w, dt / n_substeps, n_substeps)
        self.t += dt


@njit(cache=True)
def _step_all(
    state: State, body: Body, command: Floats, wind: Floats, dt: float, n_substeps: int
) -> None:
    for i in range(len(state.p)):
        for _ in range(n_substeps):
            step_one(i, state, body, command, wind, dt)


@njit(cache=True)
def step_one(i: int, state: State, body: Body, command: Floats, wind: Floats, dt: float) -> None:
    """Simulate vehicle i for one substep dt [s]; command (n,4) 0…1, wind (n,3) m/s, world."""
    p, v, q, omega = state.p[i], state.v[i], state.q[i], state.omega[i]
    mass = body.mass[i]
    jx, jy, jz = body.inertia[i]
    lag = 1.0 - math.exp(-dt / body.motor_time[i])

    # Motors: first-order lag of speed; thrust goes with the square of speed.
    force = 0.0
    torque_x, torque_y, torque_z = body.torque[i]
    for k in range(4):
        change = lag * (command[i, k] * body.motor_gain[i] - state.motor[i, k])
        state.motor[i, k] += change
        thrust = body.thrust_max[i, k] * state.motor[i, k] ** 2 * body.lift[i]
        force += thrust
        torque_x += MOTOR_Y[k] * body.lever[i] * thrust
        torque_y -= MOTOR_X[k] * body.lever[i] * thrust
        torque_z += MOTOR_SPIN[k] * (
            body.torque_coefficient[i] * thrust + body.rotor_torque[i] * change / dt
        )

    # Eq. (4), by the midpoint rule.
    x, y, z = omega[0], omega[1], omega[2]
    half = 0.5 * dt
    mx = x + half * (torque_x - (jz - jy) * y * z) / jx
    my = y + half * (torque_y - (jx - jz) * z * x) / jy
    mz = z + half * (torque_z - (jy - jx) * x * y) / jz
    nx = x + dt * (torque_x - (jz - jy) * my * mz) / jx
    ny = y + dt * (torque_y - (jx - jz) * mz * mx) / jy
    nz = z + dt * (torque_z - (jy - jx) * mx * my) / jz

    # Eq. (3): half a turn with the old rate, half with the new one.
    q0, q1, q2, q3 = rotate_by(q[0], q[1], q[2], q[3], x * half, y * half, z * half)
    xx, xy, xz = 1 - 2 * (q2 * q2 + q3 * q3), 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)
    yx, yy, yz = 2 * (q1 * q2 + q0 * q3), 1 - 2 * (q1 * q1 + q3 * q3), 2 * (q2 * q3 - q0 * q1)
    zx, zy, zz = 2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)
    q0, q1, q2, q3 = rotate_by(q0, q1, q2, q3, nx * half, ny * half, nz * half)

    # Drag in body axes, against the air.
    rx, ry, rz = v[0] - wind[i, 0], v[1] - wind[i, 1], v[2] - wind[i, 2]
    quadratic = body.drag_quadratic[i] * math.sqrt(rx * rx + ry * ry + rz * rz)
    fx = -(body.drag_linear[i, 0] + quadratic) * (xx * rx + yx * ry + zx * rz)
    fy = -(body.drag_linear[i, 1] + quadratic) * (xy * rx + yy * ry + zy * rz)
    fz = -(body.drag_linear[i, 2] + quadratic) * (xz * rx + yz * ry + zz * rz) + force

    # Eq. (2) and (1); the trapezoid is exact under constant acceleration.
    ax = (xx * fx + xy * fy + xz * fz) / mass
    ay = (yx * fx + yy * fy + yz * fz) / mass
    az = (zx * fx + zy * fy + zz * fz) / mass - GRAVITY
    vx, vy, vz = v[0] + ax * dt, v[1] + ay * dt, v[2] + az * dt
    height = p[2] + half * (v[2] + vz)

    base, east, north = body.ground[i]
    floor = base + east * p[0] + north * p[1]
    contact = height <= floor and vz - east * vx - north * vy <= 0.0
    if contact:
        # The ground stops the velocity into it at once (no bouncing), friction the velocity along
        # it; the feet stop rotation and lay the frame along the ground.
        vx, vy, vz = slide(vx, vy, vz, ax, ay, az, east, north, dt)
        height = floor
        stop = math.exp(-dt / GROUND_DAMPING_TIME)
        nx, ny, nz = nx * stop, ny * stop, nz * stop
        level = dt / GROUND_LEVELLING_TIME / math.sqrt(1.0 + east * east + north * north)
        lean_x, lean_y = zx - xx * east - yx * north, zy - xy * east - yy * north
        q0, q1, q2, q3 = rotate_by(q0, q1, q2, q3, -lean_y * level, lean_x * level, 0.0)

    sx, sy, sz = (vx - v[0]) / dt, (vy - v[1]) / dt, (vz - v[2]) / dt + GRAVITY
    state.specific_force[i, 0] = xx * sx + yx * sy + zx * sz
    state.specific_force[i, 1] = xy * sx + yy * sy + zy * sz
    state.specific_force[i, 2] = xz * sx + yz * sy + zz * sz
    p[0] += half * (v[0] + vx)
    p[1] += half * (v[1] + vy)
    p[2] = height
    v[0], v[1], v[2] = vx, vy, vz
    q[0], q[1], q[2], q[3] = q0, q1, q2, q3
    omega[0], omega[1], omega[2] = nx, ny, nz
    state.contact[i] = contact


@njit(cache=True)
def slide(
    vx: float,
    vy: float,
    vz: float,
    ax: float,
    ay: float,
    az: float,
    east: float,
    north: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return the velocity of a body on ground of these slopes after dt [s] of friction.

    vx, vy, vz: m/s, before. ax, ay, az: m/s², of all forces but the ground's.
    """
    if east == 0.0 and north == 0.0:
        grip = FRICTION * max(-az, 0.0) * dt
        speed = math.sqrt(vx * vx + vy * vy)
        keep = 1.0 - grip / speed if speed > grip else 0.0
        return vx * keep, vy * keep, 0.0
    norm2 = 1.0 + east * east + north * north
    into = (vz - east * vx - north * vy) / norm2
    vx, vy, vz = vx + into * east, vy + into * north, vz - into
    press = max(-(az - east * ax - north * ay), 0.0) / math.sqrt(norm2)
    grip = FRICTION * press * dt
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    keep = 1.0 - grip / speed if speed > grip else 0.0
    return vx * keep, vy * keep, vz * keep


@njit(cache=True)
def rotate_by(
    w: float, x: float, y: float, z: float, a: float, b: float, c: float
) -> tuple[float, float, float, float]:
    """Return a unit quaternion turned by the rotation vector (a, b, c) [rad] in its body axes."""
    angle2 = a * a + b * b + c * c
    if angle2 > 1e-8:
        angle = math.sqrt(angle2)
        s, r = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    else:
        s, r = 0.5 - angle2 / 48.0, 1.0 - angle2 / 8.0
    a, b, c = a * s, b * s, c * s
    w2 = w * r - x * a - y * b - z * c
    x2 = w * a + x * r + y * c - z * b
    y2 = w * b - x * c + y * r + z * a
    z2 = w * c + x * b - y * a + z * r
    norm = 1.0 / math.sqrt(w2 * w2 + x2 * x2 + y2 * y2 + z2 * z2)
    return w2 * norm, x2 * norm, y2 * norm, z2 * norm
