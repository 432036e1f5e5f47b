"""The camera: calibration, detector, frames, their rate and size."""

from __future__ import annotations

import time
from collections.abc import Iterator

from companion.doctor.finding import Finding, Level, either, rated
from companion.perception.camera import CalibrationError, Camera
from companion.perception.detectors import ModelError, make_detector
from companion.perception.view import load_camera
from companion.process.frame_source import FrameSource, open_source
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.video import Answer, Frame, VideoError

_WATCHED = 2.0  # s of frames


def examine(config: CompanionConfig) -> Iterator[Finding]:
    """Return all findings about the camera."""
    yield _calibration(config)
    yield _detector(config)
    try:
        source = open_source(config.camera)
    except VideoError as error:
        yield Finding(
            "camera", Level.RED, str(error), "is it plugged in, and free of other programs?"
        )
        return
    try:
        frames = _watch(source)
    except VideoError as error:
        yield Finding("camera", Level.RED, str(error), "look at cable and power")
        return
    finally:
        source.close()
    yield from _frames(config, frames)


def _calibration(config: CompanionConfig) -> Finding:
    """Examine whether the intrinsics are of this lens at this size."""
    c = config.camera
    if c.calibration is None:
        text = f"none: an ideal {c.fov_deg:g}° fisheye is assumed"
        return Finding("calibration", Level.AMBER, text, "calibrate the lens; camera.calibration")
    try:
        camera = Camera.load(c.calibration)
    except (CalibrationError, OSError) as error:
        return Finding("calibration", Level.RED, str(error), "calibrate again")
    text = f"{c.calibration}: {camera.width}×{camera.height}"
    fits = (camera.width, camera.height) == (c.width, c.height)
    return either(
        "calibration", fits, text, f"frames are {c.width}×{c.height}: calibrate at that size"
    )


def _detector(config: CompanionConfig) -> Finding:
    """Examine whether the detector can be made; a network's file must be there."""
    try:
        make_detector(load_camera(config.camera), config.sensing)
    except CalibrationError:
        return Finding("detector", Level.AMBER, "not tried without calibration", "see above")
    except ModelError as error:
        return Finding("detector", Level.RED, str(error), "put the file there; sensing.model")
    if config.sensing.detector == "color":
        todo = "mount the balls, or set sensing.detector: cnn"
        return Finding("detector", Level.AMBER, "color: detects only drones with a ball", todo)
    return Finding("detector", Level.GREEN, config.sensing.detector)


def _watch(source: FrameSource) -> list[Frame]:
    frames: list[Frame] = []
    deadline = time.monotonic() + _WATCHED
    while (left := deadline - time.monotonic()) > 0:
        if source.waits(left):
            frames.append(source.receive())
            source.answer(Answer(frames[-1].time, 0))
    return frames


def _frames(config: CompanionConfig, frames: list[Frame]) -> Iterator[Finding]:
    wanted = 1.0 / config.timing.period
    rate = len(frames) / _WATCHED
    text = f"{rate:.1f} frames a second, {wanted:.0f} wanted"
    todo = "lower the exposure time, use a faster format or bus"
    yield rated("frame rate", -rate, (-0.9 * wanted, -0.5 * wanted), text, todo)
    images = [f.arrays["image"] for f in frames if "image" in f.arrays]
    if images:
        height, width = images[-1].shape[:2]
        fits = (width, height) == (config.camera.width, config.camera.height)
        todo = f"set camera.width: {width} and camera.height: {height}"
        yield either("frame size", fits, f"{width}×{height}", todo)
        frozen = len(images) > 1 and bool((images[0] == images[-1]).all())
        yield either(
            "picture",
            not frozen,
            "the same picture again and again" if frozen else "moves",
            "look at the camera; restart it",
            Level.RED,
        )
