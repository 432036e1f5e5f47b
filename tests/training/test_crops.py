"""What the network is trained on: the same crops for a step, labels that fit the picture."""

import numpy as np
import pytest

from training.crops import CROP, Crops
from training.data import DRONE, GROUND, MOST, OPEN, OTHER, SIZE, UNCLEAR, WANTED, Shard, U, V


def shard(kind=GROUND, drone=False):
    """Two grey pictures of one class; drone: with a white square of 16 px at (320, 200)."""
    pictures = np.full((2, 400, 640, 3), 90, np.uint8)
    rows = np.full((2, MOST, 4), -1.0, np.float32)
    classes = np.full((2, 400, 640), kind, np.uint8)
    if drone:
        pictures[:, 192:208, 312:328] = 255
        classes[:, 192:208, 312:328] = DRONE
        rows[:, 0] = 319.5, 199.5, 8.0, 1.0
    return Shard(pictures, rows, classes)


def test_a_step_has_one_batch_and_steps_differ():
    a, b = (Crops([shard(drone=True)], None, [], 3).batch(7, 4) for _ in range(2))
    for first, second in zip(a, b, strict=True):
        assert np.array_equal(first, second)
    other = Crops([shard(drone=True)], None, [], 3).batch(8, 4)
    assert not np.array_equal(a.pictures, other.pictures)


def test_labels_stay_with_the_drone_under_zoom_shift_and_mirror(monkeypatch):
    monkeypatch.setattr(Crops, "_paste", lambda *_: None)
    batch = Crops([shard(OTHER, drone=True)], None, [], 1).batch(1, 24)
    seen = 0
    for rows, classes in zip(batch.labels, batch.classes, strict=True):
        u, v, size, wanted = rows[0]
        inside = 0 <= u < CROP[1] and 0 <= v < CROP[0]
        if wanted == 1.0 and inside:
            seen += 1
            assert classes[round(float(v)), round(float(u))] == DRONE
            assert 8.0 * 0.59 < size < 8.0 * 1.51
    assert seen > 8


def test_pictures_without_content_stay_so():
    batch = Crops([shard(UNCLEAR)], None, [], 1).batch(1, 12)
    assert (batch.classes == UNCLEAR).all()
    assert (batch.labels[..., WANTED] < 1).all()


def test_drawn_drones_are_labelled_where_they_are():
    batch = Crops([shard(OTHER)], None, [], 2).batch(1, 24)
    wanted = [(c, r) for c, rows in zip(batch.classes, batch.labels, strict=True) for r in rows]
    large = [(c, r) for c, r in wanted if r[WANTED] == 1.0 and r[SIZE] > 6]
    assert len(large) > 3
    for classes, row in large:
        v, u = np.nonzero(classes == DRONE)
        nearest = np.hypot(u - row[U], v - row[V]).min()
        assert nearest < row[SIZE]


def test_a_crop_of_a_real_picture_has_no_classes():
    real = Shard(shard().pictures, shard().drones, np.full((2, 1, 1), OPEN, np.uint8))
    batch = Crops([shard()], real, [], 4).batch(1, 16)
    of_real = (batch.classes == OPEN).all(axis=(1, 2))
    assert 0 < of_real.sum() < 16
    assert batch.gains == pytest.approx(np.clip(batch.gains, 0.3 / 255, 5 / 255))
