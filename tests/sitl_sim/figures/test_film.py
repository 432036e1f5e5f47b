"""The film of a flight: as long as asked, the drones where the truth has them."""

import cv2
import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.figures.bird_view import BirdView
from sitl_sim.figures.film import Film
from sitl_sim.recording.run_folder import load_run
from tests.sitl_sim import flights

COLOURS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]])
SHORT = ["--start", "4", "--end", "6", "--rate", "5", "--width", "320"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))


@pytest.mark.parametrize("suffix", ["mp4", "webm", "webp"])
def test_a_film_is_as_long_and_as_wide_as_asked(folder, suffix, tmp_path, capfd):
    out = tmp_path / f"film.{suffix}"
    assert main(["video", str(folder), *SHORT, "--speed", "1", "--out", str(out)]) == 0
    assert capfd.readouterr().out.strip().endswith(str(out))
    if suffix == "webp":
        _, film = cv2.imreadanimation(str(out))
        pictures = [f[..., :3] for f in film.frames]
    else:
        capture, pictures = cv2.VideoCapture(str(out)), []
        while (read := capture.read())[0]:
            pictures.append(read[1])
    assert len(pictures) == 10
    assert pictures[0].shape[:2] == (180, 320)
    assert np.abs(pictures[0].astype(int) - pictures[-1].astype(int)).mean() > 0.5


def test_the_drones_stand_where_the_truth_has_them(folder):
    run = load_run(folder)
    path = run.truth["position"].reshape(-1, 3)
    view = BirdView(run.world, path, (800, 720))
    corners, _ = view.project(path)
    assert (corners > 0).all()  # the whole flight is in the picture
    assert (corners < [800, 720]).all()
    p = run.truth["position"][400]
    image = view.draw(p, p[:, None], COLOURS, 0.2, chosen=0)
    places, _ = view.project(p)
    for (x, y), colour in zip(places.round().astype(int), COLOURS, strict=True):
        patch = image[y - 6 : y + 7, x - 6 : x + 7].reshape(-1, 3).astype(int)
        assert (np.abs(patch - colour).max(axis=1) < 40).any()


def test_the_moment_before_the_first_tick_can_be_shown(folder):
    assert Film(load_run(folder), 1).at(0.0).shape == (720, 1280, 3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--drone", "drone9"], "no such drone; valid: drone1, drone2, drone3"),
        (["--start", "9", "--end", "3"], "no time between them"),
        (["--speed", "0"], "greater than 0"),
        (["--out", "film.avi", *SHORT], "must end in .mp4, .webm or .webp"),
        (["--out", "no/such/folder/film.mp4", *SHORT], "cannot be written"),
    ],
)
def test_what_cannot_be_filmed_is_told_in_one_line(folder, options, said, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    assert main(["video", str(folder), *options]) == 2
    assert said in capsys.readouterr().err
