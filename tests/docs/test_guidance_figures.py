"""The pictures of guidance.md are those that the present code draws."""

import importlib.util
import re

import numpy as np
import pytest

from tests.docs.tutorial import ROOT

pytest.importorskip("matplotlib")


def test_the_pictures_are_drawn_by_the_present_code(tmp_path, monkeypatch):
    path = ROOT / "docs" / "guidance_figures.py"
    spec = importlib.util.spec_from_file_location("guidance_figures", path)
    figures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(figures)
    monkeypatch.setattr(figures, "OUT", tmp_path / "guidance.svg")
    figures.main()
    now, kept = (p.read_text("utf-8") for p in (figures.OUT, ROOT / "docs" / "guidance.svg"))
    now, kept = _numbers(now), _numbers(kept)
    assert len(now) == len(kept), "python docs/guidance_figures.py draws others"
    assert np.abs(now - kept).max() < 0.5


def _numbers(svg):
    """All numbers of the drawing but for its head [points]."""
    return np.array(re.findall(r"-?\d+\.?\d*", svg[svg.index("figure_1") :]), float)
