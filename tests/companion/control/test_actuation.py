"""What is not known of the delay limits the body rates."""

import numpy as np
import pytest

from companion.control.actuation import within_doubt
from companion.estimation.delay import Delay


def test_a_known_short_delay_lets_plans_pass():
    omega = np.array([1.5, -1.2, 3.0])
    np.testing.assert_array_equal(within_doubt(omega, Delay(0.045, 0.003)), omega)


@pytest.mark.parametrize(
    ("delay", "fastest"), [(Delay(0.06, 0.1), 0.333), (Delay(0.3, 0.004), 0.993)]
)
def test_a_delay_in_doubt_or_long_slows_tilting(delay, fastest):
    omega = np.array([1.8, -2.4, 0.1])
    limited = within_doubt(omega, delay)
    np.testing.assert_allclose(limited[:2] / omega[:2], fastest / 3.0, rtol=0.02)
    assert limited[2] == 0.1
    assert within_doubt(np.array([0, 0, -3.0]), delay)[2] == pytest.approx(
        -min(3.0, 3 * fastest), rel=0.02
    )
