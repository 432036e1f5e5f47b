"""Flows of the ground and filters that saw them, for tests of the velocity by sight."""

import numpy as np

from companion.estimation.height import Height
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.velocity_by_sight import VelocityFromGround
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.shared.frames import quaternion_from_euler
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
HEIGHT = Height(2.0, 0.15)
STILL = np.zeros(3)
CALM = OwnDoubt(velocity=0.1, tilt=0.0, yaw=0.05)
QUIET = 0.085**2  # m²/s², of a flow without motion, 1 m over ground, in a tenth of a second
KNOWN = Height(1.0, 0.0)


def that_has_seen_ground():
    """A filter to which the ground has passed as told for five seconds, at 1.5 m/s."""
    ground, v = VelocityFromGround(), np.array([1.5, 0.0, 0.0])
    for k in range(1, 51):
        before, after = (
            VehicleState(0.1 * j, 0.1 * j * v, v, LEVEL, np.zeros(3)) for j in (k - 1, k)
        )
        flow = GroundFlow(before.time, after.time, 0.1 * v[:2], HEIGHT.value)
        ground.see(flow, before, after, HEIGHT, OwnDoubt())
    return ground


def see(ground, off, after=0.1, dt=0.1, v=STILL, height=KNOWN, doubt=CALM, yaws=(0.0, 0.0)):
    """Show a flow that is (2,) m/s `off` the velocity, between two headings [rad]."""
    states = [
        VehicleState(t, STILL, v, quaternion_from_euler(0.0, 0.0, yaw), STILL)
        for t, yaw in zip((after - dt, after), yaws, strict=True)
    ]
    flow = GroundFlow(after - dt, after, dt * (v[:2] + off), height.value)
    ground.see(flow, *states, height, doubt)


def that_saw(off, **how):
    """A filter that has seen one flow, `off` (2,) m/s."""
    ground = VelocityFromGround()
    see(ground, np.array(off), **how)
    return ground


def error_of(ground, time=0.1, doubt=CALM):
    """The error (3,) m/s that is found of a velocity of 0."""
    return ground.decide(time, STILL, doubt).error
