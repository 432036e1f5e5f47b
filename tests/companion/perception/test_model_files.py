"""A network's file that is exchanged: while it runs, and before the next start."""

import subprocess
import sys

import numpy as np
import pytest

from companion.perception import cnn, eyes
from companion.perception.camera import Camera
from companion.perception.detectors import ModelError
from companion.perception.heat_map import HeatMapConfig
from companion.perception.networks import OnnxNetwork
from mavlink_bridge.wire.video import FrameServer
from tests.companion.patience import PATIENCE

PICTURE = np.random.default_rng(0).integers(50, 200, (400, 640, 3), np.uint8)


def heat_map(model):
    network = OnnxNetwork(model, 640, 400)
    return lambda: network.run(PICTURE).tobytes()


def packaged_eyes(model):
    network = eyes.Eyes(model)
    return lambda: network.look(PICTURE).drones.tobytes() + network.look(PICTURE).scene.tobytes()


LOADED = [(heat_map, cnn.PACKAGED), (packaged_eyes, eyes.PACKAGED)]


@pytest.mark.row("28")
@pytest.mark.parametrize(("load", "packaged"), LOADED)
def test_a_running_network_does_not_notice_that_its_file_is_overwritten_or_deleted(
    tmp_path, load, packaged
):
    model = tmp_path / "own.onnx"
    model.write_bytes(packaged.read_bytes())
    look = load(model)
    before = look()
    with model.open("r+b") as file:  # in place: a file mapped into memory would change
        file.write(bytes(packaged.stat().st_size))
    assert look() == before
    model.write_bytes(b"")
    assert look() == before
    model.unlink()
    assert look() == before
    with pytest.raises(ModelError):
        load(model)


@pytest.mark.row("28")
def test_the_network_of_another_detector_is_refused_with_what_it_gives(tmp_path):
    model = tmp_path / "own.onnx"
    model.write_bytes(eyes.PACKAGED.read_bytes())
    with pytest.raises(ModelError, match=rf"^{model}: gives "):
        cnn.CnnDetector(Camera.equidistant(640, 400), HeatMapConfig(), model)


@pytest.mark.row("28")
@pytest.mark.parametrize(("detector", "other"), [("cnn", eyes), ("network", cnn)])
def test_a_daemon_does_not_start_with_the_network_of_another_detector(tmp_path, detector, other):
    file = tmp_path / "drone.yaml"
    frames = FrameServer("127.0.0.1", 0)
    file.write_text(
        "fileversion: 2\nlink: {endpoint: 'udpin:127.0.0.1:0'}\n"
        f"camera: {{source: 'sim:127.0.0.1:{frames.port}'}}\n"
        f"sensing: {{detector: {detector}, model: {other.PACKAGED}}}\n"
    )
    ended = subprocess.run(
        [sys.executable, "-m", "companion", "run", str(file)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    frames.close()
    assert ended.returncode == 78
    (line,) = ended.stderr.splitlines()
    assert line.startswith("cannot start ")
    assert str(other.PACKAGED) in line
