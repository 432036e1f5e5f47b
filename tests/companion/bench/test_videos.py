"""Real videos: labels as MATLAB wrote them, and what counts as found."""

from pathlib import Path

import numpy as np
import pytest

from companion.bench.labels import LabelError
from companion.bench.video_labels import read_boxes
from companion.bench.videos import VideoTally, _centres, videos
from companion.perception.camera import Camera
from companion.types import Detection

LABELS = Path(__file__).with_name("V_AIRPLANE_002_LABELS.mat")  # of the public set, CC0
CAMERA = Camera.equidistant(640, 400)


def test_boxes_of_a_matlab_file():
    boxes = read_boxes(LABELS)
    shown = [n for n, frame in enumerate(boxes) if frame]
    assert (len(boxes), shown[0], shown[-1]) == (301, 0, 300)
    assert set(boxes[0]) == set(boxes[300]) == {"AIRPLANE"}
    first, last = boxes[0]["AIRPLANE"], boxes[300]["AIRPLANE"]
    assert first == pytest.approx(np.array([[341.0, 150.0, 49.0, 37.0]]), abs=1e-3)
    assert last == pytest.approx(np.array([[355.5244, 252.5851, 238.5082, 150.0114]]), abs=1e-3)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "x.mat").write_bytes(b"no MATLAB" * 40)
    with pytest.raises(LabelError, match=r"x\.mat: not a MATLAB groundTruth file"):
        read_boxes(tmp_path / "x.mat")
    with pytest.raises(LabelError, match=r"no videos V_CLASS_NNN\.mp4 of odd number"):
        list(videos(tmp_path, odd=True))
    (tmp_path / "V_DRONE_001.mp4").write_bytes(b"")
    (tmp_path / "V_DRONE_001_LABELS.mat").write_bytes(LABELS.read_bytes())
    (video,) = videos(tmp_path, odd=True)
    with pytest.raises(LabelError, match="not a video that OpenCV reads"):
        next(video.frames(1))


def test_what_counts_as_found():
    tally = VideoTally()
    boxes = {
        "DRONE": np.array([[100.0, 100, 12, 6], [300, 100, 40, 40]]),
        "BIRD": np.array([[500.0, 300, 20, 20], [20, 20, 20, 20]]),
    }
    tally.add(np.array([[105.0, 102], [301, 139], [505, 310], [400, 400], [106, 103]]), boxes)
    figures = tally.figures()
    assert figures["drones"]["8–16 px"] == {"wanted": 1, "recall": 1.0}
    assert figures["drones"]["from 32 px"] == {"wanted": 1, "recall": 1.0}
    assert figures["others"]["bird"] == {"shown": 2, "taken_for_drones": 0.5}
    assert figures["false_per_picture"] == 1.0
    tally.add(np.zeros((0, 2)), boxes)
    assert tally.figures()["drones"]["8–16 px"] == {"wanted": 2, "recall": 0.5}


class Bright:
    """Detects each white pixel."""

    def detect(self, image):
        rows, columns = np.nonzero(image[..., 0] == 255)
        return [Detection(r, 1.0) for r in CAMERA.unproject(np.column_stack([columns, rows]))]


@pytest.mark.parametrize("shape", [(400, 640), (512, 640), (900, 1300), (100, 120)])
def test_each_place_of_a_larger_picture_is_looked_at_once(shape):
    image = np.zeros((*shape, 3), np.uint8)
    places = {(5, 5), (shape[1] - 3, shape[0] - 3), (shape[1] // 3, shape[0] // 2 - 1)}
    for u, v in places:
        image[v, u] = 255
    found = _centres(image, Bright(), CAMERA)
    assert sorted(map(tuple, np.round(found).astype(int).tolist())) == sorted(places)
