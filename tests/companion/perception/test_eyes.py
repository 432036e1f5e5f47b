"""The packaged network: refused files, the same output each time, and output that is no number."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from companion.perception.camera_health import CameraFault
from companion.perception.cnn import PACKAGED as OTHER
from companion.perception.eyes import FEATURES, SCENE, Eyes
from companion.perception.frontend import PerceptionFrontend, make_view
from companion.perception.networks import ModelError, SenselessOutput
from companion.settings.config import CompanionConfig
from companion.types import Track
from mavlink_bridge.wire.video import Frame
from tests.companion.depth_images import state

PICTURE = np.random.default_rng(0).integers(50, 200, (400, 640, 3), np.uint8)


def test_missing_broken_and_other_models_are_refused(tmp_path):
    with pytest.raises(ModelError, match=r"none\.onnx: no such model file"):
        Eyes(tmp_path / "none.onnx")
    (tmp_path / "bad.onnx").write_bytes(b"not a network" * 20)
    with pytest.raises(ModelError, match=r"bad\.onnx: not a model that ONNX Runtime reads"):
        Eyes(tmp_path / "bad.onnx")
    with pytest.raises(ModelError, match=r"drones\.onnx: takes .*'picture': \[1, 3, 400, 640\]"):
        Eyes(OTHER)


def test_two_runtimes_give_the_same_bytes():
    first, second = Eyes().look(PICTURE), Eyes().look(PICTURE.copy())
    assert first.drones.tobytes() == second.drones.tobytes()
    assert first.scene.tobytes() == second.scene.tobytes()
    assert first.scene.shape == (2, *SCENE)
    assert (first.scene >= 0).all()
    assert (first.scene.sum(axis=0) <= 1.001).all()


@pytest.mark.parametrize("channel", range(5))
def test_an_output_that_is_no_number_is_refused(monkeypatch, channel):
    eyes, drones, scene = Eyes(), np.zeros((1, 5, 50, 80), np.float32), np.zeros((1, 2, *SCENE))
    drones[0, channel, 3, 4] = np.nan
    features = np.zeros((1, FEATURES, 50, 80), np.float32)
    session = SimpleNamespace(run=lambda names, inputs: (drones, scene, features))
    monkeypatch.setattr(eyes, "_session", session)
    with pytest.raises(SenselessOutput, match="NaN"):
        eyes.look(PICTURE)


def frontend(monkeypatch, outputs):
    """A frontend whose network gives these pairs of drones and scene, one for each picture."""
    config = CompanionConfig.model_validate(
        {"sensing": {"detector": "network", "obstacles": "network", "trunks_every": 1}}
    )
    made = PerceptionFrontend(
        make_view(config.camera, config.sensing), config.sensing, config.camera_health
    )
    given = iter(outputs)

    class Session:
        def run(self, names, inputs):
            drones, scene = next(given)
            return drones[None].copy(), scene[None].copy(), np.zeros((1, FEATURES, 50, 80))

    monkeypatch.setattr(made._network._eyes, "_session", Session())
    # The closer look takes each place for a drone: these pictures show none.
    monkeypatch.setattr(made._network._closer, "judge", lambda image, look, places: places)
    return made


def see(perception, count):
    """The results of so many frames, 0.1 s apart, seen by a drone that hovers level at 2 m."""
    found = []
    for n in range(count):
        picture = np.roll(PICTURE, n, axis=0)
        frame = Frame(0.1 * n, {"image": picture})
        found.append(perception.see(0.1 * n, frame, lambda t: state([0.0, 0.0, 2.0])))
    return found


DRONES = np.zeros((5, 50, 80), np.float32)
GROUND = np.zeros((2, *SCENE), np.float32)
GROUND[1, SCENE[0] // 2 :] = 1.0
NOTHING = np.full((2, *SCENE), 1 / 3, np.float32)


@pytest.mark.parametrize("bad", ["unclear", "nan-scene", "inf-drones", "hot-drones"])
def test_a_picture_that_shows_nothing_is_a_fault_that_lasts_until_it_does(monkeypatch, bad):
    fault = CameraFault.UNCLEAR if bad == "unclear" else CameraFault.SENSELESS
    wrong = {
        "unclear": (DRONES, NOTHING),
        "nan-scene": (DRONES, np.where(np.arange(SCENE[1]) == 7, np.nan, GROUND)),
        "inf-drones": (DRONES + np.inf, GROUND),
        "hot-drones": (DRONES + 2.0, GROUND),
    }[bad]
    good = (DRONES, GROUND)
    found = see(frontend(monkeypatch, [good, wrong, wrong, wrong, good]), 5)
    assert [f.fault for f in found] == [
        CameraFault.NONE,
        *[fault] * 3,
        CameraFault.NONE,
    ]
    assert [round(f.blind, 1) for f in found] == [0.0, 0.0, 0.1, 0.2, 0.0]
    assert [f.blind > 0 for f in found] == [False, True, True, True, False]
    # Such a frame is not searched: what it does not show does not count as gone.
    assert [f.own is None for f in found] == [False, True, True, True, False]
    assert [f.searched for f in found] == [True, False, False, False, True]


def test_one_pass_gives_drones_and_obstacles(monkeypatch):
    drones = DRONES.copy()
    drones[:, 24, 40] = 0.9, 0.0, 0.0, np.log(8.0), -3.0
    scene = GROUND.copy()
    scene[0, 20:60, 70:90], scene[1, 20:60, 70:90] = 1.0, 0.0
    (found,) = see(frontend(monkeypatch, [(drones, scene)]), 1)
    assert len(found.drones) == 1
    assert found.drones[0].range == pytest.approx(0.2 * CAMERA_F / 8.0, rel=0.1)
    (trunk,) = found.trunks
    assert trunk.direction[2] > 0.95
    assert found.clarity > 0.99


CAMERA_F = 640 / np.radians(160.0)


def test_pictures_are_searched_by_turns_and_known_drones_are_looked_at_in_all(monkeypatch):
    sensing = {"detector": "network", "obstacles": "network", "network": {"every": 2}}
    config = CompanionConfig.model_validate({"sensing": sensing})
    view = make_view(config.camera, config.sensing)
    perception = PerceptionFrontend(view, config.sensing, config.camera_health)
    network, calls = perception._network, []
    real = network._eyes.look
    monkeypatch.setattr(network._eyes, "look", lambda image: calls.append("search") or real(image))

    def judge(image, look, places, searched=None):
        calls.append(("look", len(places), searched is None))
        return places

    monkeypatch.setattr(network._closer, "judge", judge)
    monkeypatch.setattr(network, "trunks", lambda *_: [])
    network._feet.clarity = 1.0
    track = Track(1, np.array([4.0, 0.0, 2.0]), np.zeros(3), np.eye(6), 1.0, 0.1)
    tracks = [track, replace(track, id=2, p=np.array([4.0, 2.0, 2.0]), confirmed=False)]
    seen = []
    for n in range(5):
        picture = Frame(0.1 * n, {"image": np.roll(PICTURE, n, axis=0)})
        at = replace(state([0.0, 0.0, 2.0]), time=0.1 * n)
        seen.append(perception.see(0.1 * n, picture, lambda t, at=at: at, tracks=lambda: tracks))
    assert [found.partly for found in seen] == [False, False, True, False, True]
    assert [found.searched for found in seen] == [False, True, False, True, False]
    assert calls.count("search") == 3
    looks = [call for call in calls if call != "search"]
    assert looks[2::2] == [("look", 2, False)] * 2  # unsure ones, too, or they would end
    assert all(searched for _, _, searched in looks[:2] + looks[3:4])


def test_where_every_picture_is_searched_unsure_neighbours_are_found_by_the_search(monkeypatch):
    config = CompanionConfig.model_validate({"sensing": {"detector": "network"}})
    view = make_view(config.camera, config.sensing)
    perception = PerceptionFrontend(view, config.sensing, config.camera_health)
    asked = []
    monkeypatch.setattr(perception._network, "drones", lambda known, *_: asked.append(known) or [])
    track = Track(1, np.array([4.0, 0.0, 2.0]), np.zeros(3), np.eye(6), 1.0, 0.1)
    unsure = replace(track, id=2, p=np.array([4.0, 2.0, 2.0]), confirmed=False)
    for n in range(3):
        at = replace(state([0.0, 0.0, 2.0]), time=0.1 * n)
        frame = Frame(0.1 * n, {"image": np.roll(PICTURE, n, axis=0)})
        found = perception.see(0.1 * n, frame, lambda t, at=at: at, tracks=lambda: [track, unsure])
        assert not found.partly
    assert [len(known) for known in asked] == [1, 1, 1]
