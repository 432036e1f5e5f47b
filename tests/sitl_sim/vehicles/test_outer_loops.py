"""The autopilot's outer loops."""

import numpy as np
import pytest

from sitl_sim.vehicles.outer_loops import (
    OUTER_PERIOD,
    Control,
    OuterGains,
    make_setpoints,
    outer_loop,
)

LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])
STILL = np.zeros((1, 3))


def landing_thrust(before, seconds, hover=0.4, sink=0.7):
    """Thrust with which a landing begins, sinking as it should, after `before` by a pilot."""
    sp = make_setpoints(np.array([hover]), OuterGains())
    sp.control[0], sp.thrust[0] = Control.RATES, before
    for _ in range(round(seconds / OUTER_PERIOD)):
        outer_loop(0, sp, STILL, STILL, LEVEL, OUTER_PERIOD)
    v = np.array([[0.0, 0.0, -sink]])
    sp.control[0], sp.p[0], sp.v[0] = Control.POSITION, np.nan, v[0]
    outer_loop(0, sp, STILL, v, LEVEL, OUTER_PERIOD)
    return sp.thrust[0]


@pytest.mark.parametrize("hover_truly", [0.32, 0.4, 0.52])
def test_a_landing_begins_with_the_thrust_that_held_the_drone(hover_truly):
    assert landing_thrust(hover_truly, 3.0) == pytest.approx(hover_truly, rel=0.02)


def test_a_short_burst_of_thrust_is_mostly_forgotten():
    assert landing_thrust(1.0, 0.05) < 0.45
