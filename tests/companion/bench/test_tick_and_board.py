"""`companion bench tick` and `companion bench board`."""

import json
import sys

import pytest

from companion.__main__ import main
from companion.bench import board as boards
from companion.bench.board import Board, cheaper
from companion.perception.camera import CalibrationError
from companion.settings.config import CompanionConfig


def test_a_tick_is_measured_by_stage_and_against_another_release(capsys):
    assert main(["bench", "tick", "--rounds", "1", "--json", "--against", sys.executable]) == 0
    ours, theirs = json.loads(capsys.readouterr().out)
    assert {"tick", "vehicle", "track", "plan", "supervise"} <= ours.keys()
    assert ours.keys() == theirs.keys()
    stages = [cost["p50"] for name, cost in ours.items() if name != "tick"]
    assert 0.5 * sum(stages) < ours["tick"]["p50"] < 100.0  # and a whole tick takes its stages
    assert ours["tick"]["p50"] <= ours["tick"]["p99"]


def test_an_interpreter_that_is_not_there_is_one_line(capsys):
    assert main(["bench", "tick", "--rounds", "1", "--against", "no-python"]) == 2
    assert "--against no-python: No such file" in capsys.readouterr().err


def test_the_board_is_judged(capsys):
    status = main(["bench", "board", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["see"][0] <= found["see"][1]
    assert found["rest"][0] > 0.1
    assert 30.0 < found["memory"] < 1000.0
    assert status == (found["verdict"] == "does not fit")


@pytest.mark.parametrize(
    ("p99", "verdict"), [(40.0, "fits"), (60.0, "tight"), (90.0, "does not fit")]
)
def test_half_of_the_period_fits(p99, verdict):
    assert Board((5.0, p99 - 8.0), (3.0, 8.0), 100.0, 90.0, 1.0).verdict == verdict


def test_the_first_setting_that_fits_is_named(monkeypatch):
    def seen(config):  # twice as long with parallax, a quarter with small pictures
        slow = 2.0 if config.sensing.parallax else 1.0
        return [0.06 * slow * config.camera.width / 640]

    monkeypatch.setattr(boards, "_seen", seen)
    slow = Board((120.0, 120.0), (3.0, 8.0), 100.0, 90.0, 1.0)
    settings, price, then = cheaper(CompanionConfig(), slow)
    assert settings[-2:] == ("camera.width=320", "camera.height=200")
    assert "half the distance" in price
    assert then.tick == pytest.approx(38.0)
    monkeypatch.setattr(boards, "_seen", lambda config: [0.2])
    assert cheaper(CompanionConfig(), slow) is None


def test_a_calibrated_camera_is_not_asked_for_another_size(monkeypatch):
    def seen(config):
        if config.camera.width != 640:
            raise CalibrationError("made at 640×400")
        return [0.2]

    monkeypatch.setattr(boards, "_seen", seen)
    assert cheaper(CompanionConfig(), Board((200.0, 200.0), (3.0, 8.0), 100.0, 90.0, 1.0)) is None
