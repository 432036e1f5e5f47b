"""What the few planes of the problem are spent on."""

import numpy as np

from companion.camera import FORWARD, Camera
from companion.config import CompanionConfig
from companion.pipeline import Pipeline, TickInputs
from mavlink_bridge.frames import rotation_matrix
from mavlink_bridge.messages import Attitude, Heartbeat, LocalPosition, Received, Source
from mavlink_bridge.px4 import MODES
from mavlink_bridge.video import Frame

PLACE, LEVEL = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0])
WALL = 2.5  # m east of the drone, which looks there


def wall_ranges():
    """(32,32) m to a wall that goes from the ground to 3.9 m."""
    rays = Camera.equidistant(32, 32, 160.0).directions.reshape(-1, 3).astype(float)
    east, _, up = (rays @ rotation_matrix(np.array(FORWARD)).T).T
    ranges = np.where(east > 0.05, WALL / np.maximum(east, 0.05), np.inf)
    return np.where(np.abs(up * ranges) < 1.9, ranges, np.inf).reshape(32, 32).astype(np.float32)


def test_walls_are_planned_around_also_inside_a_narrow_fence():
    config = CompanionConfig.model_validate(
        {"fileversion": 1, "mission": {"goals": [[4.5, 0.0, 2.0]], "land": False},
         "fence": {"east": [-5.0, 5.0], "north": [-5.0, 5.0]},
         "sensing": {"neighbours": "truth", "obstacles": "map"},
         "camera": {"width": 64, "height": 64}})  # fmt: skip
    pipeline, vehicle = Pipeline(config, lambda: 0.0), Source(1, 1)
    shown = {"neighbours": np.zeros((0, 6)), "trunks": np.zeros((0, 6)), "ranges": wall_ranges()}
    for k in range(20):
        now = 10.0 + k / 10
        mode = MODES["hold" if k < 10 else "offboard"]
        heard = [Received(vehicle, Heartbeat(12, 2, True, mode, 4))]
        for t in now - 0.08 + 0.02 * np.arange(5):
            heard += [Received(vehicle, Attitude(t, LEVEL, np.zeros(3))),
                      Received(vehicle, LocalPosition(t, PLACE, np.zeros(3)))]  # fmt: skip
        out = pipeline.tick(TickInputs(now, heard, Frame(now - 0.03, shown)))
    kept = out.instance.planes[out.instance.plane_active > 0.5]
    walls = out.obstacles.planes
    assert len(walls) >= 1
    assert all(np.isclose(kept, wall).all(axis=1).any() for wall in walls)
    assert len(kept) == config.nmpc.planes
