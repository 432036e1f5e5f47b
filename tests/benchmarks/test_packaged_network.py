"""The packaged networks on pictures of seeds used for nothing else."""

import numpy as np
import pytest

from companion.bench.labels import Drones
from companion.bench.perception import TO_8, Tally, score
from companion.perception.camera import Camera
from companion.perception.cnn import PACKAGED, CnnDetector
from companion.perception.config import SensingConfig
from companion.perception.detectors import ModelError, make_detector
from companion.perception.heat_map import HeatMapConfig
from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_frames import CONDITIONS, rendered
from sitl_sim.sensors.scenes import crowded_scenes

LENS, CAMERA = Lens(640, 400), Camera.equidistant(640, 400)


@pytest.mark.parametrize(
    ("name", "recall", "precision"), [("cnn", 0.7, 0.9), ("network", 0.9, 0.95)]
)
def test_the_network_finds_bare_drones(name, recall, precision):
    detector = make_detector(CAMERA, SensingConfig(detector=name))
    bands = {TO_8: Tally()}
    for scene, image in rendered(
        crowded_scenes(5, 8, 90, LENS), CONDITIONS["clean"], "bare", LENS, 90, 8
    ):
        offsets = scene.in_camera(scene.drones - scene.p)
        ranges = np.linalg.norm(offsets, axis=1)
        drones = Drones(offsets / ranges[:, None], ranges, scene.visible, scene.velocities)
        score(bands, detector.detect(image), drones)
    figures = bands[TO_8].figures()
    assert figures["wanted"] >= 30
    assert figures["recall"] >= recall
    assert figures["precision"] >= precision
    assert figures["range_error_median"] <= 0.15


@pytest.mark.parametrize("kept", [0.5, 0.98])
def test_a_damaged_copy_is_refused_with_its_name(tmp_path, kept):
    whole = PACKAGED.read_bytes()
    copy = tmp_path / "cut.onnx"
    copy.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(ModelError, match=r"cut\.onnx"):
        CnnDetector(CAMERA, HeatMapConfig(), copy)
