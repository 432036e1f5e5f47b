"""Compiled loops over all vehicles: rate loops and rigid bodies, estimates, outer loops."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.vehicles.estimator import Estimate, estimate_one
from sitl_sim.vehicles.outer_loops import IDLE, OFF, OUTER_PERIOD, Setpoints, outer_loop
from sitl_sim.vehicles.rates import RateLoop, rate_loop, reset_rates
from sitl_sim.vehicles.rigid_body import SUBSTEP, Body, State, step_one

Floats = NDArray[np.float64]


@njit(cache=True)
def fly(
    state: State,
    body: Body,
    loop: RateLoop,
    sp: Setpoints,
    est: Estimate,
    gyro_noise: Floats,
    wind: Floats,
    first: int,
    count: int,
) -> None:
    """Simulate `count` substeps of all vehicles; the first is number `first` of the block.

    gyro_noise (n, substeps of a block, 3) rad/s; wind (n,3) m/s, world.
    """
    gyro = np.empty(3)
    for i in range(len(state.p)):
        control = sp.control[i]
        for s in range(first, first + count):
            if control <= IDLE:
                reset_rates(i, loop)
                speed = 0.0 if control == OFF else body.idle[i]
                for k in range(4):
                    loop.command[i, k] = speed
            for k in range(3):
                gyro[k] = state.omega[i, k] + est.bias[i, k] + gyro_noise[i, s, k]
            if control > IDLE:
                if state.contact[i] and sp.thrust[i] < 0.5 * sp.hover[i]:
                    reset_rates(i, loop)  # no integral while the ground holds the frame
                rate_loop(i, loop, sp.omega[i], sp.thrust[i], gyro, SUBSTEP)
            step_one(i, state, body, loop.command, wind, SUBSTEP)


@njit(cache=True)
def observe(state: State, est: Estimate, gyro_noise: Floats, substep: int) -> None:
    """Update all estimates; substep: number in the block of noise."""
    for i in range(len(state.p)):
        estimate_one(i, est, state, gyro_noise[i, substep])


@njit(cache=True)
def steer(sp: Setpoints, est: Estimate) -> None:
    """Run the outer loops of all vehicles once."""
    for i in range(len(est.p)):
        outer_loop(i, sp, est.p, est.v, est.q, OUTER_PERIOD)
