"""The closer look's training: how places are labelled; what is written can be read back."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from training.closer_augment import changed  # noqa: E402
from training.closer_cuts import DRONE, DU, DV, RATIO, SIZED, labels  # noqa: E402
from training.closer_network import CloserNetwork, export, load  # noqa: E402

SIZED_DRONE, BOXED, OPEN = (
    [100.0, 80.0, 12.0, 1.0],
    [300.0, 80.0, -40.0, 1.0],
    [500.0, 80.0, 12.0, 0.0],
)
DRONES = np.array([SIZED_DRONE, BOXED, OPEN, [-1.0] * 4], np.float32)


def one(place, size):
    (row,) = labels(np.array([place]), np.array([size]), DRONES)
    return row


def test_a_place_on_a_drone_tells_where_it_is_and_how_large():
    row = one((103.0, 78.0), 8.0)
    assert row[DRONE] == 1
    assert row[[DU, DV]] == pytest.approx([-3 / 32, 2 / 32])
    assert row[RATIO] == pytest.approx(np.log(12 / 8))
    assert row[SIZED] == 1


def test_of_a_box_no_size_is_known():
    row = one((305.0, 80.0), 9.0)
    assert row[DRONE] == 1
    assert row[SIZED] == row[RATIO] == 0


@pytest.mark.parametrize(
    ("place", "size"),
    [((112.0, 80.0), 12.0), ((100.0, 80.0), 60.0), ((330.0, 80.0), 9.0), ((500.0, 80.0), 12.0)],
)
def test_beside_a_drone_of_another_size_or_on_one_that_is_open_nothing_is_learnt(place, size):
    assert one(place, size)[DRONE] == -1


def test_elsewhere_there_is_none():
    assert (one((200.0, 300.0), 12.0) == 0).all()
    assert labels(np.zeros((2, 2)), np.ones(2), DRONES[3:]).tolist() == [[0.0] * 5] * 2


def test_a_mirrored_cut_out_has_its_drone_on_the_other_side():
    torch.manual_seed(0)
    pictures, rows = torch.full((64, 6, 40, 40), 50.0), torch.zeros(64, 5)
    pictures[:, :, 15:25, 25:35], rows[:, DU] = 200.0, 0.25
    out, told = changed(pictures, rows)
    grey = out.mean(dim=1)
    right = grey[:, :, 20:].mean(dim=(1, 2)) > grey[:, :, :20].mean(dim=(1, 2))
    assert torch.equal(right, told[:, DU] > 0)
    assert 10 < int(right.sum()) < 54


@pytest.mark.filterwarnings("ignore")  # torch's other exporter writes no named normalisations
def test_a_written_network_is_read_back_and_gives_the_same_in_flight(tmp_path):
    from companion.perception.closer_look import CloserLook, around, cut_outs
    from companion.perception.eyes import Eyes
    from companion.perception.heat_map import Peaks

    torch.manual_seed(1)
    network, file = CloserNetwork(), tmp_path / "closer.onnx"
    with torch.no_grad():  # equal values would be written once
        for value in network.state_dict().values():
            if value.is_floating_point():
                value.add_(0.02 * torch.rand_like(value))
    export(network, str(file))
    again = CloserNetwork()
    again.load_state_dict(load(str(file)), strict=False)
    picture = np.random.default_rng(0).integers(0, 256, (400, 640, 3), np.uint8)
    places, sizes = np.array([[300.0, 200.0], [9.0, 390.0]]), np.array([10.0, 40.0])
    cut = torch.from_numpy(cut_outs(picture, places, sizes)).permute(0, 3, 1, 2).float()
    look = Eyes().look(picture)
    said = torch.from_numpy(around(look, places))
    wanted = torch.sigmoid(again.eval()(cut, said)[:, 0]).detach().numpy()
    found = CloserLook(file).judge(picture, look, Peaks(places, sizes, np.ones(2), np.zeros(2)))
    assert np.sort(found.scores) == pytest.approx(np.sort(wanted), abs=1e-5)
