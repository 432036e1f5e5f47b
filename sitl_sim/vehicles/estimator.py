"""State estimates of the autopilots: truth with drift, noise, bias and lag, from a seed.

Noise is drawn in blocks of one second for each vehicle, from the seed and the system id alone: a
vehicle's noise depends neither on the other vehicles nor on how often it is read.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.vehicles.rigid_body import State, rotate_by
from sitl_sim.vehicles.sensor_noise import SensorNoise

Floats = NDArray[np.float64]

BLOCK_SUBSTEPS = 1000
TICK_SUBSTEPS = 10
DRIFTS = 9  # position, velocity, attitude


class Estimate(NamedTuple):
    """Estimates of n vehicles, and their errors.

    p (n,3) m, v (n,3) m/s, q (n,4), omega (n,3) rad/s: in the frames of the truth. drift (n,9):
    errors of p, v, and attitude (rotation vector, body). bias (n,3) rad/s: of the gyro. lag (n,) s.
    error (n,9): further errors, as drift: slow ones and those of faults (`StateErrors`).
    """

    p: Floats
    v: Floats
    q: Floats
    omega: Floats
    drift: Floats
    bias: Floats
    lag: Floats
    error: Floats


class Estimator:
    """Noise of all vehicles for the kernels.

    gyro_noise: (n,1000,3) rad/s, of one second; `next_block` draws that of the next.
    """

    def __init__(self, system_ids: list[int], noise: list[SensorNoise], seed: int) -> None:
        n = len(system_ids)
        self._rngs = [np.random.default_rng([seed, 0x5E45, i]) for i in system_ids]
        sigma = [[s.position] * 3 + [s.velocity] * 3 + [s.attitude] * 3 for s in noise]
        time = [
            [s.position_time] * 3 + [s.velocity_time] * 3 + [s.attitude_time] * 3 for s in noise
        ]
        self._keep = np.exp(-TICK_SUBSTEPS * 1e-3 / np.array(time).reshape(n, DRIFTS))
        self._kick = np.array(sigma).reshape(n, DRIFTS) * np.sqrt(1.0 - self._keep**2)
        self._gyro = np.array([s.gyro for s in noise])
        bias = np.array([s.gyro_bias for s in noise])[:, None]
        self.estimate = Estimate(
            p=np.zeros((n, 3)),
            v=np.zeros((n, 3)),
            q=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
            omega=np.zeros((n, 3)),
            drift=np.zeros((n, DRIFTS)),
            bias=bias * self._draw((3,)),
            lag=np.array([s.lag for s in noise]),
            error=np.zeros((n, DRIFTS)),
        )
        self.gyro_noise = np.zeros((n, BLOCK_SUBSTEPS, 3))
        self._kicks = np.zeros((n, BLOCK_SUBSTEPS // TICK_SUBSTEPS, DRIFTS))
        self.next_block()

    def _draw(self, shape: tuple[int, ...]) -> Floats:
        return np.array([r.standard_normal(shape) for r in self._rngs]).reshape(-1, *shape)

    def next_block(self) -> None:
        """Draw the noise of the next second."""
        self.gyro_noise[:] = self._gyro[:, None, None] * self._draw((BLOCK_SUBSTEPS, 3))
        self._kicks[:] = self._kick[:, None] * self._draw(self._kicks.shape[1:])

    def step_drifts(self, tick: int) -> None:
        """Step the drifts by one tick (10 ms), number `tick` of the block."""
        drift = self.estimate.drift
        drift *= self._keep
        drift += self._kicks[:, tick]


@njit(cache=True)
def estimate_one(i: int, est: Estimate, state: State, noise: Floats) -> None:
    """Update the estimate of vehicle i from the truth; noise: (3,) rad/s, of the gyro now."""
    lag = est.lag[i]
    q0, q1, q2, q3 = state.q[i]
    f = state.specific_force[i]
    for k in range(3):
        est.p[i, k] = state.p[i, k] + est.drift[i, k] + est.error[i, k] - lag * state.v[i, k]
        est.v[i, k] = state.v[i, k] + est.drift[i, 3 + k] + est.error[i, 3 + k]
        est.omega[i, k] = state.omega[i, k] + est.bias[i, k] + noise[k]
    if lag > 0.0 and not state.contact[i]:
        est.v[i, 0] -= lag * (
            (1 - 2 * (q2 * q2 + q3 * q3)) * f[0]
            + 2 * (q1 * q2 - q0 * q3) * f[1]
            + 2 * (q1 * q3 + q0 * q2) * f[2]
        )
        est.v[i, 1] -= lag * (
            2 * (q1 * q2 + q0 * q3) * f[0]
            + (1 - 2 * (q1 * q1 + q3 * q3)) * f[1]
            + 2 * (q2 * q3 - q0 * q1) * f[2]
        )
    x, y, z = (
        est.drift[i, 6] + est.error[i, 6],
        est.drift[i, 7] + est.error[i, 7],
        est.drift[i, 8] + est.error[i, 8],
    )
    a, b, c, d = rotate_by(q0, q1, q2, q3, x, y, z)
    est.q[i, 0], est.q[i, 1], est.q[i, 2], est.q[i, 3] = a, b, c, d
