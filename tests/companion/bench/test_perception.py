"""`companion bench perception` on frames of two drones that hover."""

import json

import cv2
import numpy as np
import pytest

from companion.__main__ import main
from companion.perception.camera import Camera
from sitl_sim.scenarios.scenario import load

CAMERA = Camera.equidistant(640, 400)
DRONES = [((0.2, 0.0, 1.0), 3.0), ((-0.9, 0.1, 0.6), 5.0)]


def label(ray, distance, **more):
    direction = (np.array(ray) / np.linalg.norm(ray)).tolist()
    return {"direction": direction, "range": distance, "v": [0.0, 0.0, 0.0], **more}


@pytest.fixture
def folder(tmp_path):
    """Frames of a flight in which two marked drones hover."""
    CAMERA.save(tmp_path / "camera.yaml")
    image = np.full((400, 640, 3), 110, np.uint8)
    for ray, distance in DRONES:
        ((u, v),) = CAMERA.project(np.array([ray]))
        theta = np.arccos(ray[2] / np.linalg.norm(ray))
        across = CAMERA.fx * 0.1 / distance
        axes = (across, across * theta / np.sin(theta))
        turn = np.degrees(np.arctan2(v - CAMERA.cy, u - CAMERA.cx))
        shape = ((u * 16, v * 16), (32 * axes[0], 32 * axes[1]), turn)
        big = np.zeros((400 * 16, 640 * 16), np.uint8)
        cv2.ellipse(big, shape, 255, -1)
        share = cv2.resize(big, (640, 400), interpolation=cv2.INTER_AREA)[..., None] / 255
        image = (image * (1 - share) + np.array([200.0, 20, 235]) * share).astype(np.uint8)
    rows = []
    for n in range(15):
        cv2.imwrite(str(tmp_path / f"{n}.png"), image)
        drones = [label(*d, visible=1.0) for d in DRONES]
        state = {"altitude": 2.0, "q": [1, 0, 0, 0], "p": [0, 0, 2.0], "v": [0, 0, 0]}
        sequence = {"conditions": "sequence", "sequence": 0, "time": n / 10}
        rows.append({"file": f"{n}.png", "drones": drones, **state, **sequence})
    (tmp_path / "frames.json").write_text(json.dumps({"frames": rows}))
    return tmp_path


def test_perception_is_measured_on_labelled_frames(folder, capsys):
    by_colour = ["--frames", str(folder), "--detector", "color", "--json"]
    assert main(["bench", "perception", *by_colour]) == 0
    result = json.loads(capsys.readouterr().out)
    seen = result["drones"]["sequence"]["0.3–8 m"]
    assert (seen["wanted"], seen["recall"], seen["precision"]) == (30, 1.0, 1.0)
    assert seen["bearing_rms_deg"] < 0.3
    assert seen["range_error_median"] < 0.05
    tracked = result["tracks"]["0.3–8 m"]
    assert tracked["recall"] == 1.0
    assert tracked["velocity_rmse_m_s"] < 0.3
    assert result["time_ms"]["detect_track"]["p50"] > 0.0


def test_the_detector_is_the_one_that_flies_where_none_is_named(folder, capsys):
    assert main(["bench", "perception", "--frames", str(folder), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["detector"] == load("forest", []).sensing.eyes == "network"
    assert result["drones"]["sequence"]["0.3–8 m"]["recall"] == 1.0


def test_an_unlabelled_drone_is_a_false_detection(folder, capsys):
    listing = json.loads((folder / "frames.json").read_text())
    for row in listing["frames"]:
        row["drones"] = row["drones"][:1]
    (folder / "frames.json").write_text(json.dumps(listing))
    assert main(["bench", "perception", "--frames", str(folder), "--detector", "color"]) == 0
    whole = next(l for l in capsys.readouterr().out.splitlines() if "0.3–8 m" in l)
    assert whole.split()[2:4] == ["1.000", "0.500"]


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda f: (f / "frames.json").unlink(), "no list of frames"),
        (lambda f: (f / "3.png").unlink(), r"3.png: not a picture"),
        (lambda f: (f / "camera.yaml").write_text("width: 640"), "missing height"),
        (lambda f: (f / "frames.json").write_text('{"frames": [{"file": "1.png"}]}'), "frame 0"),
    ],
)
def test_a_folder_that_cannot_be_used_is_refused(folder, capsys, spoil, told):
    spoil(folder)
    assert main(["bench", "perception", "--frames", str(folder)]) == 2
    assert told in capsys.readouterr().err
