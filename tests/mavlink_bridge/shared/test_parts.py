"""Parts by name: packaged, by entry point, by module:Class; mistakes name the choices."""

import sys

import numpy as np
import pytest

from companion.control.baselines import CONTROLLERS, BaselinesConfig, ControllerSetup, make_planner
from companion.control.nmpc import NmpcConfig
from companion.guidance.gaze import GAZES, GazeConfig, make_gaze
from companion.perception.camera import Camera
from companion.perception.config import DETECTORS, SensingConfig
from companion.perception.detectors import make_detector
from companion.settings.config import load_config
from mavlink_bridge.shared.parts import PartError
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.world import GENERATORS, WorldConfig
from tests.own_parts import install


@pytest.fixture
def installed(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(install(tmp_path / "site")))
    yield
    sys.modules.pop("own_parts", None)


def test_parts_of_an_installed_package_stand_beside_the_packaged_ones(installed):
    assert CONTROLLERS.names()[0] == "nmpc"
    assert "keep-right" in CONTROLLERS.names()
    for kind, name, target in (
        (CONTROLLERS, "keep-right", "KeepRight"),
        (DETECTORS, "blobs", "Blobs"),
        (GAZES, "straight", "Straight"),
        (GENERATORS, "avenue", "avenue"),
    ):
        assert kind.load(name) is kind.load(f"own_parts:{target}")
        assert kind.load(name).__name__ == target


@pytest.mark.parametrize("kind", [CONTROLLERS, DETECTORS, GAZES, GENERATORS])
def test_the_packaged_parts_come_through_the_same_door(kind):
    for name in kind.packaged:
        assert callable(kind.load(name))


def test_options_reach_an_own_part(installed):
    setup = ControllerSetup(NmpcConfig(), BaselinesConfig(), 1.0, lambda: 0.0, {"reach": 7.0})
    planner = make_planner("keep-right", setup)
    assert planner._rule.reach == 7.0
    sensing = SensingConfig(detector="own_parts:Blobs", detector_options={"radius": 0.5})
    assert make_detector(Camera.equidistant(640, 400), sensing).radius == 0.5
    gaze = make_gaze(GazeConfig(kind="straight", survey=0.0))
    assert type(gaze).__name__ == "Straight"
    ahead, lost = np.array([1.0, 0.0, 0.0]), [1.5, -1.5]
    yaws = [gaze.update(0.1 * tick, ahead, ahead, 0.0, lost) for tick in range(40)]
    assert yaws == [0.0] * 40  # where it flies, whatever is lost
    world = build(WorldConfig(generator="avenue", options={"trees": 2}), 1)
    assert len(world["cylinders"]) == 4
    assert world == build(WorldConfig(generator="avenue", options={"trees": 2}), 1)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("nmcp", "no controller 'nmcp'; did you mean 'nmpc'\\? valid: nmpc, single-horizon, "),
        ("nowhere:Class", "nowhere cannot be imported: ModuleNotFoundError: No module named 'no"),
        ("own_parts:KeepLeft", "no 'KeepLeft' in own_parts; it has .*KeepRight"),
        ("own_parts:math", "is no class or function"),
        ("own_parts:Blobs", "a controller has the methods reset, solve or velocity or command"),
    ],
)
def test_a_bad_name_is_told_with_its_place_and_the_choices(installed, value, words, tmp_path):
    file = tmp_path / "drone1.yaml"
    file.write_text(f"fileversion: 2\ncontroller: {value}\n")
    with pytest.raises(SettingsError, match=rf"drone1.yaml:2:1: controller: .*{words}"):
        load_config(file)


def test_a_module_that_fails_while_it_is_imported_is_told(tmp_path, monkeypatch):
    (tmp_path / "broken_part.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PartError, match="broken_part cannot be imported: ZeroDivisionError"):
        DETECTORS.check("broken_part:Any")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return [1]", "returned no mapping of cylinders and boxes"),
        ("return {'trees': []}", "returned: trees: unknown key; valid: boxes, cylinders"),
        (
            "return {'cylinders': [{'x': 1.0, 'y': 0.0, 'radius': -1.0}]}",
            "cylinders.0.radius: must be > 0",
        ),
    ],
)
def test_a_world_that_is_none_is_told(body, words, tmp_path, monkeypatch):
    (tmp_path / "odd_world.py").write_text(f"def make(world, rng):\n    {body}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    sys.modules.pop("odd_world", None)
    with pytest.raises(SettingsError, match=words):
        build(WorldConfig(generator="odd_world:make"), 1)
