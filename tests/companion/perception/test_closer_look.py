"""The closer look: what is cut out, what is refused, and what becomes of places that are judged."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from companion.perception.background import Moved
from companion.perception.camera import Camera
from companion.perception.closer_look import CHANNELS, SIDE, CloserLook, around, cut_outs, widths
from companion.perception.cnn import PACKAGED as OTHER
from companion.perception.config import SensingConfig
from companion.perception.eyes import FEATURES, Look
from companion.perception.eyes import PACKAGED as EYES
from companion.perception.heat_map import HeatMap, NetworkConfig, Peaks
from companion.perception.network_search import NetworkSearch
from companion.perception.networks import ModelError, SenselessOutput

CAMERA = Camera.equidistant(640, 400)
GREY = np.full((400, 640, 3), 90, np.uint8)
LOOK = Look(
    np.zeros((5, 50, 80), np.float32),
    np.zeros((2, 100, 160)),
    np.zeros((FEATURES, 50, 80), np.float32),
)


def peaks(places, sizes, scores=None):
    n = len(sizes)
    scores = np.zeros(n) if scores is None else np.array(scores, float)
    return Peaks(np.array(places, float).reshape(-1, 2), np.array(sizes, float), np.ones(n), scores)


@pytest.mark.parametrize("size", [6.0, 10.0, 25.0, 80.0])
@pytest.mark.parametrize("place", [(300.0, 200.0), (317.3, 181.6)])
def test_a_disc_is_cut_out_in_the_middle_and_always_as_large(size, place):
    middle = np.round(np.array(place) * 64).astype(int)
    picture = cv2.circle(GREY.copy(), middle, round(size * 64), 3 * [250], -1, cv2.LINE_AA, 6)
    drawn = np.sqrt(((picture[..., 0] - 90.0) / 160).sum() / np.pi)  # px, radius
    (cut,) = cut_outs(picture, np.array([place]), np.array([size]))
    bright = (cut[..., 0].astype(float) - 90) / 160
    rows, columns = np.mgrid[:SIDE, :SIDE]
    middle = np.array([(bright * columns).sum(), (bright * rows).sum()]) / bright.sum()
    assert middle == pytest.approx([(SIDE - 1) / 2] * 2, abs=0.15)
    shown = np.sqrt(bright.sum() / np.pi)  # radius in the cut-out
    assert shown == pytest.approx(drawn * SIDE / widths(np.array([size]))[0], rel=0.04)


def test_the_wider_cut_out_shows_a_disc_half_as_large():
    picture = cv2.circle(GREY.copy(), (300, 200), 20, 3 * [250], -1)
    (cut,) = cut_outs(picture, np.array([[300.0, 200.0]]), np.array([20.0]))
    near, wide = ((cut[..., k].astype(float) - 90).sum() for k in (0, 3))
    assert wide == pytest.approx(near / 4, rel=0.05)
    assert cut[SIDE // 2, SIDE // 2, 3:].tolist() == [250] * 3


def test_outside_the_picture_its_edge_goes_on():
    picture = GREY.copy()
    picture[:, :2] = 200
    (cut,) = cut_outs(picture, np.array([[0.0, 200.0]]), np.array([10.0]))
    assert (cut[:, : SIDE // 2] == 200).all()
    assert (cut[:, SIDE // 2 + 3 :] == 90).all()


def test_missing_and_other_models_are_refused(tmp_path):
    with pytest.raises(ModelError, match=r"none\.onnx: no such model file"):
        CloserLook(tmp_path / "none.onnx")
    with pytest.raises(ModelError, match=r"drones\.onnx: takes .* for a closer look takes"):
        CloserLook(OTHER)


def given(monkeypatch, closer, rows):
    """Let the network of a closer look give these rows."""
    raw = np.array(rows, np.float32).reshape(-1, CHANNELS)
    monkeypatch.setattr(closer, "_session", SimpleNamespace(run=lambda names, inputs: (raw,)))


def test_places_and_sizes_are_corrected_and_the_likeliest_comes_first(monkeypatch):
    closer = CloserLook()
    given(monkeypatch, closer, [(-1.0, 0.0, 0.0, 0.0, 0.0), (2.0, 0.1, -0.2, np.log(1.5), -2.0)])
    found = closer.judge(GREY, LOOK, peaks([(100, 100), (300, 200)], [10.0, 20.0], [0.5, 0.5]))
    assert found.scores[0] > 0.5 > found.scores[1]
    assert found.places[0] == pytest.approx([300 + 0.1 * 80, 200 - 0.2 * 80])
    assert found.sizes == pytest.approx([30.0, 10.0])
    assert found.scales[0] == pytest.approx(np.exp(-2.0))


@pytest.mark.parametrize("channel", range(CHANNELS))
def test_an_output_that_is_no_number_is_refused(monkeypatch, channel):
    closer, row = CloserLook(), np.zeros((1, CHANNELS))
    row[0, channel] = np.nan
    given(monkeypatch, closer, row)
    with pytest.raises(SenselessOutput, match="NaN"):
        closer.judge(GREY, LOOK, peaks([(100, 100)], [10.0]))


def test_a_known_drone_is_expected_where_the_lens_shows_it():
    reader = HeatMap(CAMERA, NetworkConfig())
    offsets = np.array([[0.5, -0.3, 4.0], [0.0, 0.0, -3.0], [2.0, 0.2, 3.0]])  # the second: behind
    expected, shown = reader.expected(offsets, np.array([1.0, 1.0, 0.5]))
    assert shown.tolist() == [True, False, True]
    assert expected.places == pytest.approx(CAMERA.project(offsets[[0, 2]]))
    (found,) = reader.detections(expected.first(1))
    assert found.range == pytest.approx(np.linalg.norm(offsets[0]), rel=1e-6)
    assert expected.sizes[1] < 0.7 * expected.sizes[0]


def test_who_is_known_is_looked_at_where_the_search_finds_nothing(monkeypatch):
    search = NetworkSearch(CAMERA, SensingConfig(detector="network", obstacles="network"))
    search.look(GREY)
    asked = []
    monkeypatch.setattr(
        search._closer, "judge", lambda image, look, places: asked.append(places) or places
    )
    search.drones(np.array([[0.0, 0.0, 3.0]]), np.ones(1))
    middle = CAMERA.project(np.array([[0.0, 0.0, 3.0]]))[0]
    assert (np.abs(asked[0].places - middle) < 1e-6).all(axis=1).any()


def test_a_find_far_above_the_own_height_has_to_be_surer(monkeypatch):
    sensing = SensingConfig(detector="network", network={"threshold": 0.8})
    search = NetworkSearch(CAMERA, sensing)
    search.look(GREY)
    level, above = CAMERA.project(np.array([[0.5, 0.0, 4.0], [0.0, -2.0, 4.0]]))
    judged = peaks([above, level], [9.0, 9.0], [0.75, 0.7])
    monkeypatch.setattr(search._closer, "judge", lambda *_: judged)
    assert search.drones() == []
    (found,) = search.drones(up_c=np.array([0.0, -1.0, 0.0]))
    assert CAMERA.project(found.direction[None])[0] == pytest.approx(level, abs=0.01)
    assert 0.85 < found.score < 0.99
    on_its_side = search.drones(up_c=np.array([1.0, 0.0, 0.0]))
    assert CAMERA.project(on_its_side[0].direction[None])[0] == pytest.approx(above, abs=0.01)


@pytest.mark.parametrize(
    ("score", "gained", "found"),
    [(0.7, 0.0, [0.9, 0.7]), (0.7, -1.0, [0.9]), (0.49, 0.0, [0.9]), (0.49, 1.0, [0.9, 0.72])],
)
def test_how_finds_move_decides_on_those_that_are_open(monkeypatch, score, gained, found):
    search = NetworkSearch(CAMERA, SensingConfig(detector="network", network={"threshold": 0.65}))
    for _ in range(2):
        search.look(GREY)
    judged = peaks([(100, 200), (320, 200), (500, 200)], [9.0, 9.0, 9.0], [0.99, 0.9, score])
    asked = []

    def evidence(places, *_):
        asked.extend(places[:, 0].tolist())
        return np.where(places[:, 0] == 500, gained, 0.0)

    monkeypatch.setattr(search._closer, "judge", lambda *_: judged)
    monkeypatch.setattr(search._background, "evidence", evidence)
    moved = Moved(np.eye(3), np.zeros(3), 0.1)
    drones = search.drones(moved=moved)
    assert sorted(asked) == [320, 500]  # the surest stays whatever is said
    assert sorted((d.score for d in drones), reverse=True)[1:] == pytest.approx(found, abs=0.01)


def test_a_place_that_is_found_already_is_not_looked_at_twice():
    found, known = peaks([(100, 100)], [10.0], [0.4]), peaks([(103, 101), (140, 100)], [10.0, 10.0])
    both = found.and_beside(known)
    assert both.places.tolist() == [[100, 100], [140, 100]]


def test_what_the_search_says_of_a_place_is_that_of_its_cell_and_those_around():
    look = Look(LOOK.drones.copy(), LOOK.scene, LOOK.features.copy())
    look.features[7, 11, 20], look.features[7, 10, 19] = 3.0, 5.0
    look.drones[:, 11, 20] = 0.5, 0.1, 0.2, 2.0, -1.0
    (said, corner) = around(look, np.array([[8 * 20 + 4.0, 8 * 11 + 3.0], [639.0, 399.0]]))
    assert said[-5:] == pytest.approx([0.0, 0.1, 0.2, 2.0, -1.0])
    assert (said[4 * FEATURES + 7], said[7]) == (3.0, 5.0)
    assert np.count_nonzero(said[:-5]) == 2
    assert np.count_nonzero(corner) == 1  # the logarithm of no heat


def test_a_network_of_ones_own_is_read_by_its_heat_alone():
    sensing = SensingConfig(detector="network", obstacles="network", model=str(EYES))
    search = NetworkSearch(CAMERA, sensing)
    search.look(GREY)
    assert search._closer is None
    search._look.drones[:, 20, 40] = 0.9, 0.0, 0.0, np.log(8.0), -3.0
    (found,) = search.drones()
    assert found.score == pytest.approx(0.9)


def test_a_glance_looks_at_known_drones_alone_by_what_the_search_said_where_they_were(monkeypatch):
    search = NetworkSearch(CAMERA, SensingConfig(detector="network"))
    search.look(GREY)
    monkeypatch.setattr(search._eyes, "look", lambda image: pytest.fail("searched"))
    now = np.array([[0.5, 0.0, 4.0], [0.0, 0.0, -3.0], [-1.0, 0.2, 3.0]])  # the second: behind
    then = now + np.array([0.3, 0.0, 0.0])
    asked = []

    def judge(image, look, places, searched):
        asked.append((image, look, places.places, searched))
        return peaks(places.places, places.sizes, [0.9, 0.2])

    monkeypatch.setattr(search._closer, "judge", judge)
    up = np.array([0.0, -1.0, 0.0])
    (found,) = search.glance(GREY + 1, now, np.ones(3), up, None, then)
    ((image, look, places, searched),) = asked
    assert image[0, 0, 0] == 91
    assert look is search._look
    assert places == pytest.approx(CAMERA.project(now[[0, 2]]))
    assert searched == pytest.approx(CAMERA.project(then[[0, 2]]))
    assert found.direction == pytest.approx(now[0] / np.linalg.norm(now[0]), abs=1e-6)
    assert search.glance(GREY, now[:0], np.ones(0), up, None, then[:0]) == []
