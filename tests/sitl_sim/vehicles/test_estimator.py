"""State estimates are as wrong as configured."""

from dataclasses import replace

import numpy as np

from mavlink_bridge.wire.messages import LocalPosition
from sitl_sim.vehicles.sensor_noise import SensorNoise


def test_the_errors_of_an_estimate_are_those_configured(make_flight):
    f = make_flight(noise=replace(SensorNoise(), position_time=0.05, velocity_time=0.05))
    p, v = [], []
    for k in range(1, 1000):
        f.autopilots.advance(k * 0.02)
        for m in f.autopilots.telemetry(0, "companion"):
            if isinstance(m, LocalPosition):
                p.append(m.p)
                v.append(m.v)
    np.testing.assert_allclose(np.std(p, axis=0), 0.02, rtol=0.2)
    np.testing.assert_allclose(np.std(v, axis=0), 0.03, rtol=0.2)
