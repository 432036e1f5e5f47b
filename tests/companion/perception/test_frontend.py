"""Frames in, detections out: what the frontend searches, and what it refuses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from companion.perception.camera_alignment import Alignment
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import PerceptionFrontend, make_view
from companion.settings.config import CompanionConfig
from companion.types import Detection
from mavlink_bridge.wire.video import Frame
from tests.companion.depth_images import state

NO_DRONES, NO_TRUNKS = np.zeros((0, 6)), np.zeros((0, 6))
PICTURE = np.random.default_rng(0).integers(50, 200, (400, 640, 3), np.uint8)


def at(time):
    return replace(state([0.0, 0.0, 2.0]), time=time)


def frontend(**sensing):
    config = CompanionConfig.model_validate({"sensing": sensing})
    view = make_view(config.camera, config.sensing)
    return PerceptionFrontend(view, config.sensing, config.camera_health)


def test_pictures_of_another_size_inhibit_until_they_fit():
    perception = frontend()
    wrong = Frame(0.1, {"image": PICTURE[:, :400]})
    found = perception.see(0.1, wrong, at)
    assert "400×400" in found.inhibit_reason
    assert found.fault is CameraFault.MISFIT
    found = perception.see(0.2, Frame(0.2, {"image": PICTURE}), at)
    assert found.inhibit_reason == ""
    assert found.fault is CameraFault.NONE


@pytest.mark.parametrize("obstacles", ["camera", "depth", "map"])
def test_a_frame_without_the_array_of_obstacles_is_not_searched(obstacles):
    perception = frontend(neighbours="truth", obstacles=obstacles, trunks_every=1)
    found = perception.see(0.0, Frame(0.0, {"neighbours": NO_DRONES}), at)
    assert not found.searched
    small = np.zeros((64, 64, 3), np.uint8)
    found = perception.see(0.1, Frame(0.1, {"neighbours": NO_DRONES, "image": small}), at)
    assert not found.searched


@pytest.mark.parametrize(
    ("detector", "checks", "found"), [("cnn", True, 0), ("cnn", False, 1), ("color", True, 1)]
)
def test_a_find_that_depth_denies_counts_only_where_depth_is_not_asked(
    monkeypatch, detector, checks, found
):
    perception = frontend(detector=detector, obstacles="depth", depth={"checks_drones": checks})
    find = Detection(np.array([0.0, 0.0, 1.0]), 1.5, 0.01, 0.2)
    monkeypatch.setattr(perception._drones, "search", lambda picture: [find], raising=False)
    monkeypatch.setattr(perception._drones, "detect", lambda image: [find])
    wall = np.full((100, 160), 3.0, np.float32)
    frame = Frame(0.1, {"image": PICTURE // 2 + 60, "depth": wall})
    assert perception.see(0.1, frame, at).drones == [find] * found


def test_each_frame_is_searched_once():
    perception = frontend(neighbours="truth", obstacles="map", trunks_every=1)
    frame = Frame(0.1, {"neighbours": NO_DRONES, "trunks": NO_TRUNKS})
    assert not perception.see(0.1, None, at).started
    first, again = (perception.see(time, frame, at) for time in (0.15, 0.2))
    assert first.started
    assert first.searched
    assert first.own is not None
    assert again.started
    assert not again.searched
    assert again.own is None


def test_trunks_are_searched_in_every_second_frame():
    perception = frontend(neighbours="truth", obstacles="map", trunks_every=2)
    arrays = {"neighbours": NO_DRONES, "trunks": NO_TRUNKS}
    found = [perception.see(0.1 * n, Frame(0.1 * n, arrays), at) for n in range(4)]
    assert [d.searched for d in found] == [False, True, False, True]


def test_impossible_detections_are_dropped():
    ahead = [0.0, 0.0, 1.0]
    drones = [
        [*ahead, 3.0, 0.01, 0.1],
        [*ahead, np.nan, 0.01, 0.1],
        [*ahead, -1.0, 0.01, 0.1],
        [0.0, 0.0, 2.0, 3.0, 0.01, 0.1],
        [*ahead, 3.0, 0.01, np.inf],
    ]
    trunks = [[*ahead, 5.0, 1.0, 0.1], [*ahead, 5.0, 0.0, 0.1]]
    perception = frontend(neighbours="truth", obstacles="map", trunks_every=1)
    frame = Frame(0.1, {"neighbours": np.array(drones), "trunks": np.array(trunks)})
    found = perception.see(0.1, frame, at)
    assert [d.range for d in found.drones] == [3.0]
    assert [t.radius for t in found.trunks] == [1.0]


def test_a_configured_lag_dates_the_picture_and_its_state_back():
    config = CompanionConfig.model_validate({"camera": {"lag": 0.08}})
    view = make_view(config.camera, config.sensing)
    perception = PerceptionFrontend(view, config.sensing, config.camera_health, config.camera.lag)
    asked = []

    def told(time):
        asked.append(time)
        return at(time)

    found = perception.see(0.5, Frame(0.5, {"image": PICTURE}), told)
    assert found.own.time == pytest.approx(0.42)
    assert found.stamp == 0.5  # from which a replay takes the lag off again
    assert 0.42 in [pytest.approx(t) for t in asked]


def test_a_measuring_flight_looks_for_nothing_and_forgives_its_mount():
    config = CompanionConfig()
    view = make_view(config.camera, config.sensing)
    rng = np.random.default_rng(1)
    scene = cv2.GaussianBlur(rng.integers(0, 255, (400, 2000, 3), np.uint8), (0, 0), 3)

    def picture(time):  # pans to the left, as a mirrored camera that is turned to the left
        left = round(60 * time * 4)
        return np.ascontiguousarray(scene[:, left : left + 640])

    def turning(time):
        own = state([0.0, 0.0, 2.0])
        return replace(own, time=time, omega=np.array([0.0, 0.0, 1.0]))

    def last(measuring):
        perception = PerceptionFrontend(
            view, config.sensing, config.camera_health, measuring=measuring
        )
        for n in range(40):
            time = 0.1 * n
            frame = Frame(time, {"image": picture(time)})
            found = perception.see(time + 0.02, frame, turning)
        return found

    assert last(measuring=False).fault is CameraFault.MISALIGNED
    found = last(measuring=True)
    assert found.fault is CameraFault.NONE
    assert found.inhibit_reason == ""
    assert found.started
    assert not found.searched
    assert not found.drones


@pytest.mark.parametrize("lag", [0.0, -0.2])
def test_a_picture_waits_until_telemetry_tells_of_its_time(lag):
    """Late telemetry: what it says now was so 0.2 s before a picture that comes now."""
    perception = frontend(neighbours="truth", obstacles="map")
    perception._alignment.estimate = Alignment(lag=lag)
    asked, seen = [], []

    def told(time):
        asked.append(time)
        return at(time)

    for n in range(1, 9):
        time = 0.1 * n
        arrays = {"neighbours": np.array([[0.0, 0.0, 1.0, n, 0.01, 0.1]]), "trunks": NO_TRUNKS}
        found = perception.see(time, Frame(time - 0.02, arrays), told)
        assert found.fault is CameraFault.NONE or n < 3
        if found.own is not None:
            assert found.own.time == pytest.approx(found.stamp - lag, abs=1e-9)
            seen.append((n, round(found.drones[0].range)))
    assert max(asked) < 0.8 + 0.05
    waits = 2 if lag else 0
    assert seen == [(n, n - waits) for n in range(1 + waits, 9)]


def test_a_recorded_frame_does_not_wait_again():
    perception = frontend(neighbours="truth", obstacles="map")
    arrays = {"neighbours": NO_DRONES, "trunks": NO_TRUNKS}
    found = perception.see(0.5, Frame(0.3, arrays, lag=-0.2), at)
    assert found.own.time == pytest.approx(0.5)


def test_a_configured_lag_waits_too():
    config = CompanionConfig.model_validate({"camera": {"lag": -0.2}})
    view = make_view(config.camera, config.sensing)
    perception = PerceptionFrontend(view, config.sensing, config.camera_health, config.camera.lag)
    found = [perception.see(0.1 * n, Frame(0.1 * n, {"image": PICTURE}), at) for n in range(1, 4)]
    assert [f.stamp for f in found] == [None, None, pytest.approx(0.1)]
    assert found[-1].own.time == pytest.approx(0.3)
