"""The whole tick: the planes that the solver gets, and the detour in its goal."""

import numpy as np
import pytest

from companion.perception.camera import FORWARD, Camera
from companion.perception.camera_health import CameraFault
from companion.pipeline import Companion
from companion.settings.config import CompanionConfig
from companion.tick import TickInputs
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition, Received, Source
from mavlink_bridge.wire.video import Frame

PLACE, LEVEL = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0])
WALL = 2.5  # m east of the drone, which looks there


def wall_ranges():
    """The ranges (32,32) m to a wall from the ground to 3.9 m."""
    rays = Camera.equidistant(32, 32, 160.0).directions.reshape(-1, 3).astype(float)
    east, _, up = (rays @ rotation_matrix(np.array(FORWARD)).T).T
    ranges = np.where(east > 0.05, WALL / np.maximum(east, 0.05), np.inf)
    return np.where(np.abs(up * ranges) < 1.9, ranges, np.inf).reshape(32, 32).astype(np.float32)


def engaged(shown, handed=10, ticks=20, later=None, heading=lambda time: 0.0, **changes):
    """The last tick of a drone that has seen `shown` for two seconds, and was handed over.

    handed: the tick in which the pilot does so. later: what it sees then; None: no pictures.
    heading: rad, as the vehicle tells it at a time [s]; its gyro tells of no turn.
    """
    config = CompanionConfig.model_validate(
        {
            "fileversion": 2,
            "mission": {"goals": [[4.5, 0.0, 2.0]], "land": False},
            "sensing": {"neighbours": "truth", "obstacles": "map"},
            "camera": {"width": 64, "height": 64},
            "airframe": {"hover_doubt": 0.05},
            **changes,
        }
    )
    companion, vehicle = Companion(config, lambda: 0.0), Source(1, 1)
    empty = {
        "neighbours": np.zeros((0, 6)),
        "trunks": np.zeros((0, 6)),
        "ranges": np.full((32, 32), np.inf, np.float32),
    }
    for k in range(ticks):
        now = 10.0 + k / 10
        mode = MODES["hold" if k < handed else "offboard"]
        heard = [Received(vehicle, Heartbeat(12, 2, True, mode, 4))]
        for t in now - 0.08 + 0.02 * np.arange(5):
            told = quaternion_from_euler(0.0, 0.0, heading(t))
            heard.append(Received(vehicle, Attitude(t, told, np.zeros(3))))
            heard.append(Received(vehicle, LocalPosition(t, PLACE, np.zeros(3))))
        sight = shown if k < 20 else later
        frame = None if sight is None else Frame(now - 0.03, empty | sight)
        tick = companion.tick(TickInputs(now, heard, frame))
    return config, tick


def trunks_at(axes):
    """Looks at trunks of 0.4 m with axes (n,2) m, east and north of the drone."""
    distance = np.hypot(*axes.T)
    n, to_camera = len(axes), rotation_matrix(np.array(FORWARD))  # east is ahead
    rays = np.column_stack([axes, np.zeros(n)]) / distance[:, None] @ to_camera
    return np.column_stack([rays, distance, np.full(n, 0.4), np.full(n, 0.03)])


@pytest.mark.parametrize(
    ("handed", "shows", "fault", "known"),
    [
        (40, True, CameraFault.SENSELESS, 0),
        (5, True, CameraFault.SENSELESS, 1),
        (40, False, CameraFault.DEAD, 1),
    ],
)
def test_what_a_camera_that_misleads_has_shown_is_forgotten_before_the_mission_alone(
    handed, shows, fault, known
):
    """Taken over with a camera upside down a drone fled from what it had seen at take-off."""
    seen = {"trunks": trunks_at(np.array([[2.5, 0.5]]))}
    _, before = engaged(seen, handed)
    assert len(before.obstacles.cylinders) == 1
    senseless = seen | {"neighbours": np.full((1, 6), np.nan)}
    _, after = engaged(seen, handed, ticks=36, later=senseless if shows else None)
    assert after.seen.fault is fault
    assert len(after.obstacles.cylinders) == known


def test_the_planes_of_walls_reach_the_solver_inside_a_narrow_fence():
    fence = {"east": [-5.0, 5.0], "north": [-5.0, 5.0]}
    config, tick = engaged({"ranges": wall_ranges()}, fence=fence)
    kept = tick.planned.instance.planes[tick.planned.instance.plane_active > 0.5]
    walls = tick.reference.obstacles.planes
    assert len(walls) >= 1
    assert all(np.isclose(kept, wall).all(axis=1).any() for wall in walls)
    assert len(kept) == config.nmpc.planes


@pytest.mark.parametrize(("apart", "turned"), [(1.5, True), (2.2, False)])
def test_the_aim_leads_round_two_trunks_without_room_between(apart, turned):
    axes = np.array([[2.5, 0.5 * apart + 0.1], [2.5, 0.1 - 0.5 * apart]])
    _, tick = engaged({"trunks": trunks_at(axes)}, gaze={"survey": 0.0})
    assert len(tick.obstacles.cylinders) == 2
    aside = tick.reference.aim[1] / tick.reference.aim[0]
    assert (abs(aside) > 0.3) == turned
    assert np.allclose(tick.planned.instance.goal, tick.reference.aim)
    assert np.allclose(tick.reference.progress.goal, [4.5, 0.0, 2.0])


def test_what_was_seen_turns_with_a_heading_that_turns_without_the_gyro():
    """A compass goes wrong by 0.2 rad after the last picture."""
    shown = {
        "neighbours": np.array([[0.0, 0.0, 1.0, 3.0, 0.01, 0.05]]),
        "trunks": np.array([[0.6, 0.0, 0.8, 4.0, 0.3, 0.1]]),
    }

    def wrong(time):
        return 0.2 * np.clip((time - 12.0) / 0.4, 0.0, 1.0)

    _, tick = engaged(shown, ticks=27, heading=wrong)
    (trunk,), (track,) = tick.obstacles.cylinders, tick.tracks
    c, s = np.cos(0.2), np.sin(0.2)
    east, north = 3.2, -2.4  # as it was seen, to the right
    assert trunk[:2] == pytest.approx([c * east - s * north, s * east + c * north], abs=0.15)
    assert track.p[:2] == pytest.approx([3.0 * c, 3.0 * s], abs=0.15)
