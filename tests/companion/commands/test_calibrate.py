import json

import cv2
import numpy as np
import pytest

from companion.__main__ import main
from companion.commands.calibrate_flight import _write
from companion.flightlog.recorder import Recorder
from companion.perception.camera import Camera
from companion.settings.config import bridge_of
from mavlink_bridge.shared.settings import SettingsError
from tests.companion.ticks import config, tick

TRUE = Camera(640, 400, 231.0, 229.5, 322.4, 196.8, np.array([0.03, -0.012, 0.004, -0.0006]))
BOARD, SQUARE = (9, 6), 0.1


def picture(rng):
    """A chessboard in front of the lens `TRUE`, by casting rays."""
    towards = rng.uniform([-0.9, -0.5], [0.9, 0.5])
    turn = cv2.Rodrigues(np.array([-towards[1], towards[0], 0]) + rng.normal(0, 0.25, 3))[0]
    ray = np.array([np.sin(towards[0]), np.sin(towards[1]), 1.0])
    centre = ray / np.linalg.norm(ray) * rng.uniform(0.55, 0.9)
    u, v = np.meshgrid(np.arange(0, 640, 0.5), np.arange(0, 400, 0.5))
    rays = TRUE.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    normal = turn[:, 2]
    t = (normal @ centre) / np.where(np.abs(rays @ normal) < 1e-6, np.nan, rays @ normal)
    on = (rays * t[:, None] - centre) @ turn[:, :2] / SQUARE + np.array(BOARD) / 2 + 0.5
    cell = np.floor(on)
    inside = (t > 0) & (cell >= 0).all(axis=1) & (cell < np.array(BOARD) + 1).all(axis=1)
    margin = (t > 0) & (on > -0.7).all(axis=1) & (on < np.array(BOARD) + 1.7).all(axis=1)
    grey = np.where(inside & (cell.sum(axis=1) % 2 == 0), 30.0, np.where(margin, 220.0, 110.0))
    image = grey.reshape(400, 2, 640, 2).mean(axis=(1, 3)) + rng.normal(0, 2, (400, 640))
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("boards")
    rng = np.random.default_rng(3)
    for n in range(16):
        cv2.imwrite(str(made / f"{n:02d}.png"), picture(rng))
    return made


def test_the_lens_is_found_again(folder, capsys):
    out = folder / "camera.yaml"
    pictures = sorted(str(p) for p in folder.glob("*.png"))
    options = ["--board", "9x6", "--square", str(SQUARE), "--out", str(out), "--json"]
    assert main(["calibrate", *pictures, *options]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["rms_px"] < 0.3
    found = Camera.load(out)
    assert (found.width, found.height) == (640, 400)
    angle = np.radians(np.arange(0, 65, 5))
    for turn in (0.0, 1.5, 3.0, 4.5):
        rays = np.stack(
            [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=1
        )
        miss = np.linalg.norm(found.project(rays) - TRUE.project(rays), axis=1)
        assert np.nanmax(miss) < 1.0


def test_too_few_boards_and_no_pictures_are_told(folder, tmp_path, capsys):
    pictures = [str(folder / "00.png"), str(folder / "01.png")]
    assert main(["calibrate", *pictures, "--out", str(tmp_path / "c.yaml")]) == 2
    assert "at least 6 must" in capsys.readouterr().err
    (tmp_path / "x.png").write_text("no picture")
    assert main(["calibrate", str(tmp_path / "x.png")]) == 2
    assert "x.png: not a picture" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["calibrate", *pictures, "--board", "9by6"])
    assert "COLUMNSxROWS" in capsys.readouterr().err


def test_a_log_without_corners_and_mixed_files_are_told(folder, tmp_path, capsys):
    log = tmp_path / "flight.mcap"
    recorder = Recorder(config(log), log)
    for n in range(3):
        recorder.write(*tick(n), [], {}, {})
    recorder.close()
    assert main(["calibrate", str(log)]) == 2
    assert "holds no corners: fly with mission.commission" in capsys.readouterr().err
    assert main(["calibrate", str(log), str(log)]) == 2
    assert "one flight at a time" in capsys.readouterr().err
    assert main(["calibrate", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err
    assert main(["calibrate", str(folder / "00.png"), "--write", "drone.yaml"]) == 2
    assert "takes a flight" in capsys.readouterr().err


def test_a_betaflights_bridge_gets_the_hover_thrust_and_a_bad_change_is_undone(tmp_path):
    drones = tmp_path / "drones"
    assert main(["config", "examples", "--copy", str(drones)]) == 0
    file = drones / "drone3.yaml"
    changes = {("airframe", "hover_thrust"): 0.5123, ("camera", "lag"): 0.01}
    shown = _write(file, changes)
    assert shown.count("0.5123") == 2
    assert main(["check", *(str(p) for p in drones.glob("*.yaml"))]) == 0
    before = file.read_text(), bridge_of(file).read_text()
    with pytest.raises(SettingsError, match=r"camera\.lag"):
        _write(file, changes | {("camera", "lag"): 3.0, ("airframe", "hover_thrust"): 0.4})
    assert (file.read_text(), bridge_of(file).read_text()) == before
