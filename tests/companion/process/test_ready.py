"""A whole companion, blind or deaf: its inputs decide whether it takes control and goes on."""

import numpy as np
import pytest

from companion.perception.camera import Camera
from companion.perception.camera_health import CameraFault
from companion.pipeline import Companion
from companion.settings.config import CompanionConfig
from companion.supervision.guard import Reason
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    CommandId,
    Heartbeat,
    LocalPosition,
    Received,
    Source,
)
from mavlink_bridge.wire.video import Frame

SEEN = {"neighbours": np.array([[0.0, 0, 1, 5, 0.01, 0.1]]), "trunks": np.zeros((0, 6))}


class Vehicle:
    """A companion and its inputs, tick by tick."""

    def __init__(self, sensing="truth", obstacles="map", enforce=True, **mission):
        config = {
            "fileversion": 2,
            "camera": {"width": 64, "height": 64},
            "airframe": {"hover_doubt": 0.05},
            "sensing": {"neighbours": sensing, "obstacles": obstacles},
            "mission": {"goals": [[40.0, 0.0, 2.0]], **mission},
            "certificate": {"enforce": enforce},
        }
        self.companion = Companion(CompanionConfig.model_validate(config), lambda: 0.0)
        self.time = 10.0

    def tick(self, mode="hold", *, armed=True, height=2.0, telemetry=True, frame=-0.03, seen=SEEN):
        """Fly the next tick; mode None: no heartbeat.

        frame: s from the tick to the stamp of its frame; None: no frame.
        """
        self.time = round(self.time + 0.1, 3)
        received = [Heartbeat(12, 2, armed, MODES[mode], 4)] if telemetry and mode else []
        for age in (0.06, 0.04, 0.02) if telemetry else ():
            p = np.array([0.0, 0.0, height])
            received += [
                Attitude(self.time - age, np.array([1.0, 0, 0, 0]), np.zeros(3)),
                LocalPosition(self.time - age, p, np.zeros(3)),
            ]
        picture = None if frame is None else Frame(self.time + frame, seen)
        heard = [Received(Source(1, 1), m) for m in received]
        return self.companion.tick(TickInputs(self.time, heard, picture))


def phase(tick):
    return tick.supervised.phase


def fault(tick):
    return tick.seen.fault


def commands(ticks, number):
    """The requests of one MAV_CMD among the messages of the ticks."""
    requests = [m for t in ticks for m in t.supervised.requests]
    return [m for m in requests if isinstance(m, Command) and m.command == number]


def arming(ticks):
    return commands(ticks, CommandId.COMPONENT_ARM_DISARM)


@pytest.mark.row("7")
def test_without_telemetry_the_drone_does_not_arm():
    vehicle = Vehicle(auto=True)
    for _ in range(15):
        assert phase(vehicle.tick(armed=False, height=0.0, frame=None)) is Phase.WAIT
    silent = [vehicle.tick(telemetry=False, frame=None) for _ in range(5)]
    silent += [vehicle.tick(telemetry=False) for _ in range(15)]
    assert {phase(t) for t in silent} == {Phase.WAIT}
    assert not arming(silent)
    again = [vehicle.tick(armed=False, height=0.0) for _ in range(5)]
    assert arming(again)


@pytest.mark.row("7")
def test_after_a_silence_nothing_is_requested_before_a_heartbeat_tells_the_mode():
    vehicle = Vehicle()
    for mode in ["hold"] * 10 + ["offboard"] * 20:
        assert phase(vehicle.tick(mode)) is not Phase.PASSIVE
    silent = [vehicle.tick(telemetry=False) for _ in range(35)]
    assert commands(silent, CommandId.DO_SET_MODE)
    back = [vehicle.tick(None) for _ in range(9)] + [vehicle.tick("rtl") for _ in range(20)]
    assert not [m for t in back for m in t.supervised.requests]
    served = [m for t in back for m in t.served.messages]
    assert any(isinstance(m, Heartbeat) for m in served)  # our own, as before
    assert not any(isinstance(m, Command) for m in served)
    assert phase(back[-1]) is Phase.PASSIVE


@pytest.mark.row("15")
def test_a_camera_that_dies_after_the_first_request_ends_the_arming():
    vehicle = Vehicle(auto=True)
    while phase(vehicle.tick(armed=False, height=0.0)) is not Phase.ARM:
        assert vehicle.time < 12.0
    blind = [vehicle.tick(armed=False, height=0.0, frame=None) for _ in range(40)]
    assert fault(blind[-1]) is CameraFault.DEAD
    assert phase(blind[-1]) is Phase.WAIT
    assert len(arming(blind)) <= 1


@pytest.mark.row("15")
def test_one_stamp_in_the_future_blinds_the_drone_for_one_tick():
    vehicle = Vehicle()
    for mode in ["hold"] * 10 + ["offboard"] * 20:
        vehicle.tick(mode)
    bad = vehicle.tick("offboard", frame=60.0)
    assert (fault(bad), bad.seen.own) == (CameraFault.AHEAD, None)
    assert bad.supervised.verdict.reason is Reason.BLIND
    after = [vehicle.tick("offboard") for _ in range(20)]
    assert all(fault(t) is CameraFault.NONE and t.seen.own is not None for t in after)
    assert len(after[-1].tracks) == 1


@pytest.mark.row("15")
def test_pictures_of_another_size_are_not_searched():
    picture = np.random.default_rng(0).integers(50, 200, (40, 64, 64, 3), np.uint8)
    vehicle = Vehicle("camera", enforce=False)  # noise looks like drones all round
    for mode, image in zip(["hold"] * 10 + ["offboard"] * 20, picture, strict=False):
        good = vehicle.tick(mode, seen=SEEN | {"image": image})
    assert (phase(good), fault(good)) == (Phase.FLY, CameraFault.NONE)
    bad = vehicle.tick("offboard", seen=SEEN | {"image": picture[31, :48]})
    assert fault(bad) is CameraFault.MISFIT
    assert bad.supervised.verdict.reason is Reason.BLIND
    assert "64×48 px" in bad.supervised.inhibit_reason
    again = vehicle.tick("offboard", seen=SEEN | {"image": picture[32]})
    assert fault(again) is CameraFault.NONE


def depth_of_a_trunk(camera, unknown=0.0):
    """Return a depth image of a trunk of radius 0.3 m, 3 m ahead; NaN within `unknown` rad."""
    x, _, z = np.moveaxis(camera.scaled(160, 160).directions.astype(float), -1, 0)
    across, level = np.hypot(x, z), np.arctan2(np.abs(x), z)
    root = np.maximum(0.3**2 - (3.0 * np.sin(level)) ** 2, 0.0)
    depth = np.where((root > 0) & (z > 0), (3.0 * np.cos(level) - np.sqrt(root)) / across, np.inf)
    return np.where(level < unknown, np.nan, depth).astype(np.float32)


@pytest.mark.parametrize("unknown", [0.2, 3.2])
def test_an_unknown_depth_is_no_free_view(unknown):
    """Where the depth is unknown, ahead or everywhere, the trunk seen before is remembered."""
    vehicle = Vehicle(obstacles="depth")
    camera = Camera.equidistant(64, 64, 160.0)
    drones = {"neighbours": SEEN["neighbours"][:0]}
    for _ in range(12):
        known = vehicle.tick("offboard", seen=drones | {"depth": depth_of_a_trunk(camera)})
    assert len(known.obstacles.cylinders) == 1
    for _ in range(20):
        later = vehicle.tick("offboard", seen=drones | {"depth": depth_of_a_trunk(camera, unknown)})
    assert later.obstacles.cylinders == pytest.approx(known.obstacles.cylinders)
    assert fault(later) is (CameraFault.NONE if unknown < 1.0 else CameraFault.NO_DEPTH)
    for _ in range(20):
        later = vehicle.tick("offboard", seen=drones)
    assert (len(later.obstacles.cylinders), fault(later)) == (1, CameraFault.DEAD)
    for _ in range(20):
        gone = vehicle.tick("offboard", seen=drones | {"depth": np.full((64, 64), np.inf)})
    assert not len(gone.obstacles.cylinders)
