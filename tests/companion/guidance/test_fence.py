"""What the few planes of the problem are spent on, and ways round what the plan does not see."""

import numpy as np
import pytest

from companion.guidance.fence import FenceConfig
from companion.perception.camera import FORWARD, Camera
from companion.pipeline import Pipeline, TickInputs
from companion.settings.config import CompanionConfig
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.settings import SettingsError, parse_yaml, validate
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition, Received, Source
from mavlink_bridge.wire.video import Frame

PLACE, LEVEL = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0])
WALL = 2.5  # m east of the drone, which looks there


def wall_ranges():
    """(32,32) m to a wall that goes from the ground to 3.9 m."""
    rays = Camera.equidistant(32, 32, 160.0).directions.reshape(-1, 3).astype(float)
    east, _, up = (rays @ rotation_matrix(np.array(FORWARD)).T).T
    ranges = np.where(east > 0.05, WALL / np.maximum(east, 0.05), np.inf)
    return np.where(np.abs(up * ranges) < 1.9, ranges, np.inf).reshape(32, 32).astype(np.float32)


def engaged(shown, **changes):
    """The last tick of a drone that has seen `shown` for two seconds and was handed over."""
    config = CompanionConfig.model_validate(
        {"fileversion": 2, "mission": {"goals": [[4.5, 0.0, 2.0]], "land": False},
         "sensing": {"neighbours": "truth", "obstacles": "map"},
         "camera": {"width": 64, "height": 64}, **changes})  # fmt: skip
    pipeline, vehicle = Pipeline(config, lambda: 0.0), Source(1, 1)
    empty = {"neighbours": np.zeros((0, 6)), "trunks": np.zeros((0, 6)),
             "ranges": np.full((32, 32), np.inf, np.float32)}  # fmt: skip
    for k in range(20):
        now = 10.0 + k / 10
        mode = MODES["hold" if k < 10 else "offboard"]
        heard = [Received(vehicle, Heartbeat(12, 2, True, mode, 4))]
        for t in now - 0.08 + 0.02 * np.arange(5):
            heard += [Received(vehicle, Attitude(t, LEVEL, np.zeros(3))),
                      Received(vehicle, LocalPosition(t, PLACE, np.zeros(3)))]  # fmt: skip
        out = pipeline.tick(TickInputs(now, heard, Frame(now - 0.03, empty | shown)))
    return config, out


def test_walls_are_planned_around_also_inside_a_narrow_fence():
    fence = {"east": [-5.0, 5.0], "north": [-5.0, 5.0]}
    config, out = engaged({"ranges": wall_ranges()}, fence=fence)
    kept = out.instance.planes[out.instance.plane_active > 0.5]
    walls = out.obstacles.planes
    assert len(walls) >= 1
    assert all(np.isclose(kept, wall).all(axis=1).any() for wall in walls)
    assert len(kept) == config.nmpc.planes


@pytest.mark.parametrize(("apart", "turned"), [(1.5, True), (2.2, False)])
def test_the_aim_leads_round_two_trunks_without_room_between(apart, turned):
    axes = np.array([[2.5, 0.5 * apart + 0.1], [2.5, 0.1 - 0.5 * apart]])
    distance = np.hypot(*axes.T)
    rays = (
        np.column_stack([axes, np.zeros(2)])
        / distance[:, None]
        @ rotation_matrix(np.array(FORWARD))
    )  # east is ahead: world to camera
    trunks = np.column_stack([rays, distance, np.full(2, 0.4), np.full(2, 0.03)])
    _, out = engaged({"trunks": trunks}, gaze={"survey": 0.0})
    assert len(out.obstacles.cylinders) == 2
    aside = out.aim[1] / out.aim[0]
    assert (abs(aside) > 0.3) == turned
    assert np.allclose(out.instance.goal, out.aim)
    assert np.allclose(out.progress.goal, [4.5, 0.0, 2.0])


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
