"""Colours of `companion doctor`: on a terminal only, and not where NO_COLOR is set."""

import sys

import pytest

from companion.commands import doctor
from companion.doctor import Level
from companion.doctor.finding import Finding


@pytest.mark.parametrize(
    ("terminal", "no_color", "colourful"),
    [(True, None, True), (True, "", True), (True, "1", False), (False, None, False)],
)
def test_no_color_is_respected(terminal, no_color, colourful, monkeypatch, capsys):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color is not None:
        monkeypatch.setenv("NO_COLOR", no_color)
    doctor._print(Finding("camera", Level.GREEN, "10 Hz"))
    assert ("\033[" in capsys.readouterr().out) is colourful
