"""The fence as half-spaces, and what is left of a side that is crossed."""

import numpy as np
import pytest

from companion.estimation.height import Height
from companion.guidance.fence import FenceConfig
from companion.perception.ground_plane import GroundPlane
from mavlink_bridge.shared.settings import SettingsError, parse_yaml, validate


def test_the_fence_has_sides_and_a_top():
    fence = FenceConfig(east=[-5.0, 8.0], north=[-3.0, 3.0], altitude_max=5.0)
    assert fence.planes().shape == (5, 4)
    outside, outward = fence.across(np.array([9.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0]))
    assert (outside, outward) == (1.0, 1.0)
    assert fence.across(np.array([0.0, 0.0, 2.0]), np.zeros(3))[0] == -3.0
    assert len(fence.near(np.array([7.0, 0.0, 2.0]), 0.6)) == 3
    assert FenceConfig().near(np.zeros(3), 0.6).shape == (0, 4)
    with pytest.raises(SettingsError, match=r"f:1:1: east: must be \[least, most\]"):
        validate(FenceConfig, parse_yaml("east: [3.0, -3.0]", "f"), "f")


def test_a_side_that_is_crossed_lets_the_drone_go_no_farther():
    """Else the plan would come back at any price, through a trunk, too: they share one slack."""
    fence = FenceConfig(east=[-5.0, 5.0], north=[-5.0, 5.0])
    outside = fence.near(np.array([5.7, 4.8, 2.0]), 0.6)
    east, north = outside[outside[:, 0] > 0][0], outside[outside[:, 1] > 0][0]
    assert east[3] == pytest.approx(5.7 + 0.6)
    assert north[3] == 5.0
    assert fence.across(np.array([5.7, 4.8, 2.0]), np.zeros(3))[0] == pytest.approx(0.7)


@pytest.mark.row("21")
def test_a_goal_of_a_drone_outside_is_brought_within_the_sides_that_it_crossed():
    fence = FenceConfig(east=[-5.0, 5.0], north=[-5.0, 5.0])
    goal = np.array([9.0, -7.0, 2.0])

    def moved(p):
        return (goal + fence.back(np.array(p), goal, 0.6)).tolist()

    assert moved([4.9, 0.0, 2.0]) == goal.tolist()
    assert moved([5.1, 0.0, 2.0]) == pytest.approx([4.4, -7.0, 2.0])
    assert moved([5.1, -5.1, 2.0]) == pytest.approx([4.4, -4.4, 2.0])
    assert moved([-5.1, 0.0, 2.0]) == goal.tolist()  # the goal leads back by itself
    assert not FenceConfig().back(np.array([99.0, 99.0, 2.0]), goal, 0.6).any()


@pytest.mark.row("34")
def test_the_floor_follows_the_ground_and_its_doubt():
    fence = FenceConfig(altitude_min=0.8)
    assert fence.floor(None) == 0.8
    assert fence.floor(Height(1.5, 0.05, ground=GroundPlane(0.5))) == pytest.approx(1.3)
    assert fence.floor(Height(1.5, 0.4, ground=GroundPlane(0.5))) == pytest.approx(1.5)
    assert fence.floor(Height(1.5, 9.0, ground=GroundPlane(0.5))) == pytest.approx(1.8)
    assert fence.floor(Height(5.0, 0.05, ground=GroundPlane(-3.0))) == pytest.approx(-2.2)


def test_plans_stay_in_a_band_around_the_goal_above_the_floor():
    fence = FenceConfig(altitude_max=5.0, altitude_band=1.0)
    assert fence.altitude_planes(2.0, 0.8, 2.0, 0.6)[:, 3].tolist() == [3.0, -1.0]
    assert fence.altitude_planes(2.0, 1.6, 2.3, 0.6)[:, 3].tolist() == [3.0, -1.6]
    top, bottom = fence.altitude_planes(2.0, 6.0, 6.15, 0.1)[:, 3] * [1.0, -1.0]
    assert top > bottom == 6.0  # hills as high as the fence: the ground counts


def test_one_pushed_out_of_the_band_must_only_go_no_farther_out():
    fence = FenceConfig(altitude_max=5.0, altitude_band=0.5)
    above, below = (
        fence.altitude_planes(2.0, 0.3, 2.4, 0.3),
        fence.altitude_planes(2.0, 0.3, 1.4, 0.3),
    )
    assert above[:, 3] == pytest.approx([2.7, -1.5])
    assert below[:, 3] == pytest.approx([2.5, -1.1])
    assert fence.altitude_planes(2.0, 0.3, 5.5, 0.3)[0, 3] == pytest.approx(5.8)  # the guard's
    low = fence.altitude_planes(2.0, 1.3, 1.4, 0.3)
    assert low[1, 3] == pytest.approx(-1.3)  # but never nearer to the ground
