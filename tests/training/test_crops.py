"""What the network is trained on: the same crops for a step, labels that fit the picture."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from training.crops import CROP, Crops  # noqa: E402
from training.data import (  # noqa: E402
    DRONE,
    GROUND,
    MOST,
    OPEN,
    OTHER,
    SIZE,
    UNCLEAR,
    WANTED,
    Shard,
    U,
    V,
    complete,
    load,
    save,
)
from training.dice import Dice  # noqa: E402
from training.ring import Ring  # noqa: E402
from training.sprites import Pasted, drawn_sprites, paste  # noqa: E402
from training.videos import CutOut  # noqa: E402


def shard(kind=GROUND, drone=False):
    """Two grey pictures of one class; drone: with a white square of 16 px at (320, 200)."""
    pictures = np.full((2, 400, 640, 4), 90, np.uint8)
    rows = np.full((2, MOST, 4), -1.0, np.float32)
    pictures[..., 3] = kind
    if drone:
        pictures[:, 192:208, 312:328, :3] = 255
        pictures[:, 192:208, 312:328, 3] = DRONE if kind != OPEN else OPEN
        rows[:, 0] = 319.5, 199.5, 8.0, 1.0
    return Shard(pictures, rows)


def ring(*shards, capacity=8):
    """A ring of shards on the CPU."""
    made = Ring(capacity, 400, 640, "cpu")
    for each in shards:
        made.add(each)
    return made


@pytest.fixture(scope="module")
def sprites(tmp_path_factory):
    """Three drawn drones of each size, and a bird."""
    bird = CutOut(np.full((9, 21, 3), 20, np.uint8), np.ones((9, 21), np.float32), False)
    return drawn_sprites(tmp_path_factory.mktemp("sprites"), [bird], 3, "cpu")


def test_a_step_has_one_batch_and_steps_differ(sprites):
    a, b = (Crops(ring(shard(drone=True)), None, sprites, 3).batch(7, 4) for _ in range(2))
    for first, second in zip(a, b, strict=True):
        assert torch.equal(first, second)
    other = Crops(ring(shard(drone=True)), None, sprites, 3).batch(8, 4)
    assert not torch.equal(a.pictures, other.pictures)


@pytest.mark.parametrize("seed", [1, 2])
def test_labels_stay_with_the_drone_under_zoom_shift_and_mirror(seed):
    batch = Crops(ring(shard(OTHER, drone=True)), None, [], seed).batch(1, 24)
    seen = 0
    for rows, classes in zip(batch.labels, batch.classes, strict=True):
        u, v, size, wanted = rows[0].tolist()
        if wanted != 1.0:
            continue
        shown_v, shown_u = np.nonzero(classes.numpy() == DRONE)
        if 20 < u < CROP[1] - 20 and 20 < v < CROP[0] - 20:
            seen += 1
            assert abs(shown_u.mean() - u) < 0.6
            assert abs(shown_v.mean() - v) < 0.6
            assert len(shown_u) ** 0.5 / 2 == pytest.approx(size, abs=0.6)
        assert 8.0 * 0.64 < size < 8.0 * 1.51
    assert seen > 8


def test_half_of_the_rendered_crops_are_not_interpolated():
    noise = np.random.default_rng(1).integers(0, 255, (2, 400, 640, 4), np.uint8)
    noise[..., 3] = OTHER
    crops = Crops(ring(Shard(noise, shard().drones)), None, [], 1)
    crops._strange.light = lambda _, image: image
    crops._strange.repaint = lambda _, image, __: image
    batch = crops.batch(1, 8)
    values = set(map(tuple, noise[..., :3].reshape(-1, 3).tolist()))
    for n, picture in enumerate(batch.pictures):
        # One gain for the whole crop: black to white tells it.
        shown = (picture / picture.max() * noise[..., :3].max()).round()
        kept = [tuple(p) in values for p in shown.flatten(1).T[:400].int().tolist()]
        assert (np.mean(kept) > 0.9) == (n < 4)


def test_pictures_without_content_stay_so(sprites):
    batch = Crops(ring(shard(UNCLEAR)), None, sprites, 1).batch(1, 12)
    assert (batch.classes == UNCLEAR).all()
    assert (batch.labels[..., WANTED] < 1).all()


def test_drawn_drones_are_labelled_where_they_are_and_birds_are_not(sprites):
    drones = others = 0
    for step in range(6):
        pictures = torch.full((40, 3, *CROP), 90.0)
        classes = torch.full((40, *CROP), OTHER, dtype=torch.uint8)
        none = torch.full((40, MOST, 4), -1.0)
        labels = paste(Dice("cpu", 1, step), sprites, Pasted(pictures, none, classes))
        for shown, painted, rows in zip(pictures, classes, labels, strict=True):
            assert ((shown != 90).any(dim=0) | (painted != DRONE)).all()
            v, u = np.nonzero(painted.numpy() == DRONE)
            wanted = rows[rows[:, WANTED] == 1.0]
            drones += len(wanted)
            others += len(u) > 0 and not len(wanted)
            for row in wanted[wanted[:, SIZE] > 6]:
                near = np.hypot(u - row[U].item(), v - row[V].item())
                assert near.min() < row[SIZE]
    assert drones > 40
    assert others > 5


def test_a_crop_of_a_real_picture_has_no_classes(sprites):
    real = ring(shard(OPEN, drone=True))
    batch = Crops(ring(shard()), real, sprites, 4).batch(1, 16)
    of_real = (batch.classes == OPEN).all(dim=2).all(dim=1)
    assert of_real.sum() == 2
    assert batch.pictures.isfinite().all()


def test_drones_in_tiny_boxes_are_left_open():
    real = shard(OPEN)
    real.drones[:, 0] = 319.5, 199.5, -5.0, 1.0
    batch = Crops(ring(shard()), ring(real), [], 4).batch(1, 40)
    rows = batch.labels[-6:, 0]
    assert (rows[:, WANTED] < 1).all()
    assert (rows[:, WANTED] == 0).any()


def test_a_ring_keeps_the_newest():
    made = ring(shard(), shard(OTHER), shard(GROUND, drone=True), capacity=5)
    assert made.count == 5
    assert made.total == 6
    assert made.pictures[0, 200, 320, 3] == DRONE
    assert made.pictures[1, 0, 0, 3] == GROUND
    assert made.brightness[1] == pytest.approx(90)


def test_a_shard_is_complete_once_all_its_files_are(tmp_path):
    save(tmp_path, "looks-000003", shard(drone=True))
    (tmp_path / "looks-000004.pictures.npy").write_bytes(b"half")
    assert complete(tmp_path) == ["looks-000003"]
    assert np.array_equal(load(tmp_path, "looks-000003").drones, shard(drone=True).drones)
