"""The rate loop and mixer: step response, disturbance, desaturation."""

import math

import numpy as np
import pytest

from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.estimator import Estimator
from sitl_sim.vehicles.kernel import fly
from sitl_sim.vehicles.outer_loops import Control, OuterGains, make_setpoints
from sitl_sim.vehicles.rates import make_rate_loop, mix
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise

AIRFRAME = Airframe()


class Bench:
    """One vehicle in the air under its rate loop alone."""

    def __init__(self, thrust=AIRFRAME.hover_thrust, noise=None):
        self.vehicles = Vehicles(AIRFRAME, [[0.0, 0.0, 100.0]], 0.0)
        self.vehicles.motor[:] = math.sqrt(AIRFRAME.hover_thrust)
        self.loop = make_rate_loop([RateGains()], [AIRFRAME])
        self.sp = make_setpoints(np.array([AIRFRAME.hover_thrust]), OuterGains())
        self.sp.control[:], self.sp.thrust[:] = int(Control.RATES), thrust
        self.sensors = Estimator([1], [noise or SensorNoise.none()], 0)

    def run(self, milliseconds):
        rates = np.empty((milliseconds, 3))
        for k in range(milliseconds):
            v, e = self.vehicles, self.sensors
            wind = np.zeros((1, 3))
            args = (self.loop, self.sp, e.estimate, e.gyro_noise, wind, k % 1000, 1)
            fly(v.state, v.body, *args)
            rates[k] = v.omega[0]
        return rates


@pytest.mark.parametrize("amplitude", [0.7, 1.4, 3.0, -1.4])
@pytest.mark.parametrize(("axis", "limit_ms"), [(0, 55), (1, 55), (2, 75)])
def test_step_response(axis, limit_ms, amplitude):
    if axis == 2 and abs(amplitude) > 2:
        limit_ms = 120  # a large yaw step runs into the limit of its torque
    bench = Bench()
    bench.run(200)
    bench.sp.omega[0, axis] = amplitude
    response = bench.run(400)[:, axis] / amplitude
    assert np.argmax(response > 0.63) < 42
    assert np.argmax(response > 0.9) < limit_ms
    assert response.max() < 1.08
    assert np.abs(response[250:] - 1.0).max() < 0.03


def test_axes_stay_apart():
    bench = Bench()
    bench.sp.omega[0] = [1.5, 0.0, 0.0]
    rates = bench.run(300)
    assert np.abs(rates[:, 1:]).max() < 0.02


def test_setpoints_at_10_hz_are_followed():
    """A companion's 10 Hz staircase: at its end each step is reached."""
    bench = Bench()
    for amplitude in (0.5, 1.0, -1.0, 0.0, 0.8):
        bench.sp.omega[0, 0] = amplitude
        assert bench.run(100)[-1, 0] == pytest.approx(amplitude, abs=0.05)


@pytest.mark.parametrize("weak", [0, 1, 2, 3])
def test_a_weak_motor_is_trimmed_away(weak):
    bench = Bench()
    bench.vehicles.body.thrust_max[0, weak] *= 0.8
    rates = bench.run(1500)
    assert np.abs(rates).max() < 0.6
    assert np.abs(rates[-200:]).max() < 0.03


@pytest.mark.parametrize("thrust", [0.0, 0.05, 0.95, 1.0])
def test_air_mode_keeps_control_at_the_ends_of_the_throttle(thrust):
    bench = Bench(thrust)
    bench.run(100)
    bench.sp.omega[0, 0] = 1.0
    assert bench.run(300)[-1, 0] == pytest.approx(1.0, abs=0.1)


def test_noise_does_not_shake_the_vehicle():
    bench = Bench(noise=SensorNoise())
    assert bench.run(1000).std(axis=0).max() < 0.02


@pytest.mark.parametrize("ask", [(300, 0, 0), (0, -400, 50), (200, 200, 200), (0, 0, -500)])
@pytest.mark.parametrize("thrust", [0.0, 0.33, 1.0])
def test_mixer_keeps_motors_in_range_and_the_direction_of_roll_and_pitch(ask, thrust):
    loop = make_rate_loop([RateGains()], [AIRFRAME])
    mix(0, loop, *map(float, ask), thrust)
    u = loop.command[0]
    assert (u >= AIRFRAME.idle).all()
    assert (u <= 1.0).all()
    share = u**2
    roll = share[2] + share[3] - share[0] - share[1]
    pitch = share[0] + share[2] - share[1] - share[3]
    assert roll * ask[0] >= 0
    assert pitch * ask[1] >= 0


def test_thrust_is_proportional_to_force():
    loop = make_rate_loop([RateGains()], [AIRFRAME])
    for thrust in (0.1, 0.33, 0.7, 1.0):
        mix(0, loop, 0.0, 0.0, 0.0, thrust)
        force = 4 * AIRFRAME.thrust_max * loop.command[0, 0] ** 2
        assert force / AIRFRAME.mass == pytest.approx(thrust * AIRFRAME.c_max, rel=1e-9)
