"""Detections from the output of networks, and the files that are refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from companion.perception.camera import Camera
from companion.perception.detectors import ModelError, make_detector
from companion.perception.heat_map import CHANNELS, HEIGHT, STRIDE, WIDTH, HeatMap, HeatMapConfig
from companion.perception.yolo import YoloConfig, YoloDetector
from companion.settings.config import CompanionConfig
from mavlink_bridge.shared.settings import SettingsError, assignments, validate

CAMERA = Camera.equidistant(640, 400)


def config(**parts):
    return CompanionConfig.model_validate(parts)


def cells(*drones):
    """An output of drones at pixels (u, v) with a radius in pixels and heat."""
    out = np.zeros((CHANNELS, HEIGHT // STRIDE, WIDTH // STRIDE), np.float32)
    for u, v, size, heat in drones:
        x, y = (u + 0.5) / STRIDE - 0.5, (v + 0.5) / STRIDE - 0.5
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                i, j = round(y) + dy, round(x) + dx
                near = heat if dx == dy == 0 else 0.6 * heat
                out[:, i, j] = [near, x - j, y - i, np.log(size), -3.0]
    return out


def reader(camera):
    return HeatMap(camera, HeatMapConfig())


@pytest.mark.parametrize("azimuth", [0.0, 0.6, -1.2])
@pytest.mark.parametrize("distance", [1.0, 4.0, 9.0])
def test_direction_and_range_everywhere_on_the_lens(azimuth, distance):
    ray = np.array([np.sin(azimuth), 0.1, np.cos(azimuth)])
    ray /= np.linalg.norm(ray)
    ((u, v),) = CAMERA.project(ray[None])
    theta = np.arccos(ray[2])
    pixels = 0.2 / distance * CAMERA.fx * np.sqrt(theta / np.sin(theta))
    (found,) = reader(CAMERA).read(cells((u, v, pixels, 0.9)))
    assert np.degrees(np.arccos(min(found.direction @ ray, 1.0))) < 0.05
    assert found.range == pytest.approx(distance, rel=0.02)
    assert 0.0 < found.sigma_range < 0.2 * distance


def test_each_drone_is_detected_once_nearest_first():
    near = cells((300, 200, 60, 0.9), (312, 200, 58, 0.6), (420, 200, 10, 0.8), (40, 40, 9, 0.2))
    found = reader(CAMERA).read(near)
    assert len(found) == 2
    assert found[0].range < found[1].range


def test_missing_and_wrong_models_are_refused(tmp_path):
    for detector in ("cnn", "yolo"):
        wanted = config(sensing={"detector": detector, "model": str(tmp_path / "none.onnx")})
        with pytest.raises(ModelError, match=r"none\.onnx: no such model file"):
            make_detector(CAMERA, wanted.sensing)
        (tmp_path / "bad.onnx").write_bytes(b"not a network" * 20)
        wanted = config(sensing={"detector": detector, "model": str(tmp_path / "bad.onnx")})
        with pytest.raises(ModelError, match=r"bad\.onnx: not a model that OpenCV reads"):
            make_detector(CAMERA, wanted.sensing)


@pytest.mark.parametrize(("shape", "highest"), [((1, 84, 8400), 79), ((1, 25200, 7), 1)])
def test_classes_that_a_yolo_lacks_are_named(monkeypatch, tmp_path, shape, highest):
    network = SimpleNamespace(shape=shape)
    monkeypatch.setattr("companion.perception.yolo.OnnxNetwork", lambda model, w, h: network)
    YoloDetector(CAMERA, YoloConfig(classes=[0, highest]), tmp_path / "y.onnx")
    with pytest.raises(ModelError, match=rf"tells {highest + 1} classes.*\[{highest + 1}\]"):
        YoloDetector(CAMERA, YoloConfig(classes=[0, highest + 1]), tmp_path / "y.onnx")


def yolo(monkeypatch, out, **settings):
    """The detections of a network with this output (1,…)."""
    network = SimpleNamespace(shape=out.shape, run=lambda image, swap: out)
    monkeypatch.setattr("companion.perception.yolo.OnnxNetwork", lambda model, w, h: network)
    detector = YoloDetector(CAMERA, YoloConfig(**settings), "y.onnx")
    return detector.detect(np.zeros((400, 640, 3), np.uint8))


@pytest.mark.parametrize(
    ("size", "layout"), [(640, "rows"), (640, "columns"), (640, "end-to-end"), (64, "rows")]
)
def test_each_layout_of_yolo_gives_the_same_detection(monkeypatch, size, layout):
    """A box of 32 × 20 px in the middle, of the third of 80 classes; with a small input, too."""
    scale, cells = size / 640, 21 * (size // 32) ** 2
    u, v, w, h = (x * scale for x in (320.0, 200.0, 32.0, 20.0))
    if layout == "rows":
        out = np.zeros((1, 84, cells), np.float32)
        out[0, [0, 1, 2, 3, 6], 5] = u, v, w, h, 0.9
    elif layout == "columns":
        out = np.zeros((1, 3 * cells, 85), np.float32)
        out[0, 5, [0, 1, 2, 3, 4, 7]] = u, v, w, h, 1.0, 0.9
    else:
        out = np.zeros((1, 300, 6), np.float32)
        out[0, 0] = u - w / 2, v - h / 2, u + w / 2, v + h / 2, 0.9, 2
    (seen,) = yolo(monkeypatch, out, size=size, classes=[2])
    assert seen.direction == pytest.approx([0, 0, 1], abs=0.01)
    assert seen.range == pytest.approx(0.2 / np.sin(np.radians(160) * 16 / 640), rel=0.02)
    assert seen.score == pytest.approx(0.9)
    assert yolo(monkeypatch, out, size=size, classes=[1]) == []


def test_yolo_of_one_class_and_four_strides_is_not_end_to_end(monkeypatch):
    out = np.zeros((1, 3 * (8400 + 100), 6), np.float32)
    out[0, 5] = 320.0, 200.0, 32.0, 20.0, 1.0, 0.9
    (seen,) = yolo(monkeypatch, out)
    assert seen.direction == pytest.approx([0, 0, 1], abs=0.01)


def test_yolo_without_a_model_is_refused_with_its_keys():
    with pytest.raises(SettingsError, match=r"sensing\.detector: .*sensing\.model"):
        validate(CompanionConfig, assignments(["sensing.detector=yolo"]), "x")
