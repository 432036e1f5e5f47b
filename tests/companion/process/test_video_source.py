"""Cameras as frame sources: forms of address, rates, a camera that breaks off, clocks."""

import time

import cv2
import numpy as np
import pytest

from companion.perception.config import check_source
from companion.process import video_source
from companion.process.frame_source import open_source
from companion.process.pace import ClockPace
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Attitude, Received, Source
from mavlink_bridge.wire.udp import UdpEndpoint
from mavlink_bridge.wire.video import VideoError
from tests.companion.patience import PATIENCE


def camera(source, **more):
    return CompanionConfig.model_validate({"camera": {"source": source, **more}}).camera


@pytest.fixture
def film(tmp_path):
    """Eight grey frames at 20 Hz, each brighter than the last."""
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (64, 48))
    for n in range(8):
        writer.write(np.full((48, 64, 3), 20 + 25 * n, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize(
    "source",
    [
        "sim:127.0.0.1:15541",
        "device:0",
        "device:/dev/video2",
        "rtsp://10.0.0.2/main",
        "gst:v4l2src ! appsink",
        "file:/tmp/film.avi",
    ],
)
def test_valid_forms(source):
    assert check_source(source) == source


@pytest.mark.parametrize(
    "source", ["sim:127.0.0.1", "sim:127.0.0.1:0", "sim:a:99999", "device:cam", "webcam", "rtsp:x"]
)
def test_other_forms_are_refused_with_the_valid_ones(source):
    with pytest.raises(ValueError, match="device:N"):
        check_source(source)


def test_a_file_plays_at_its_rate_and_then_ends(film):
    source = open_source(camera(f"file:{film}"))
    begun = time.monotonic()
    seen, stamps = [], []

    def watch():
        while source.waits(5.0):
            frame = source.receive()
            assert frame.local
            seen.append(float(frame.arrays["image"].mean()))
            stamps.append(frame.time)

    with pytest.raises(VideoError, match="no more pictures"):
        watch()
    assert len(seen) >= 4
    assert (np.diff(seen) > 10).all()
    assert stamps[-1] - begun > 0.25
    assert all(begun <= s <= time.monotonic() for s in stamps)
    source.close()


class LooseCamera:
    """A camera whose cable works loose after each third picture."""

    def __init__(self, found):
        self.found, self.left, self.released = found, 3, False

    def isOpened(self):
        return self.found

    def grab(self):
        self.left -= 1
        return self.found and self.left >= 0

    def retrieve(self):
        return True, np.zeros((48, 64, 3), np.uint8)

    def get(self, what):
        return 0.0

    def release(self):
        self.released = True


def test_a_camera_that_breaks_off_is_opened_again(monkeypatch):
    made = [LooseCamera(True), LooseCamera(False), LooseCamera(False), LooseCamera(True)]
    coming = iter(made)
    monkeypatch.setattr(video_source, "_open", lambda *a: next(coming, made[1]))
    monkeypatch.setattr(video_source, "_REOPEN_PERIOD", 0.02)
    source = open_source(camera("device:0"))
    until = time.monotonic() + PATIENCE
    while made[-1].left > 0 and time.monotonic() < until:
        if source.waits(0.05):
            assert source.receive().arrays["image"].shape == (48, 64, 3)
    assert made[-1].left <= 0  # the second camera was seen through as well
    assert all(c.released for c in made[:3])  # or the device would be busy
    source.close()


@pytest.mark.parametrize(
    ("source", "hint"), [("file:/none/such.avi", "is it there"), ("device:/dev/none", "plugged in")]
)
def test_a_camera_that_cannot_be_opened_is_named_with_a_hint(source, hint):
    with pytest.raises(VideoError, match=hint):
        open_source(camera(source))


class ScriptedLink(Link):
    """A link that returns its messages once."""

    def __init__(self, messages):
        super().__init__(UdpEndpoint(remote=("127.0.0.1", 9)), Codec(1, 191))
        self.messages = messages

    def receive(self, renew=True):
        said, self.messages = self.messages, []
        return said


def test_frames_come_in_the_vehicles_clock(film):
    source = open_source(camera(f"file:{film}"))
    ahead = 1000.0  # s that the vehicle's clock is ahead of ours
    heard = Attitude(time.monotonic() + ahead, np.array([1.0, 0, 0, 0]), np.zeros(3))
    link = ScriptedLink([Received(Source(1, 1), heard)])
    pace = ClockPace(link, source, 0.1, Source(1, 1))
    pace.next(lambda: False)
    inputs = pace.next(lambda: False)
    assert inputs.frame is not None
    assert not inputs.frame.local
    assert abs(inputs.frame.time - inputs.time) < 0.5
    source.close()
    link.close()
