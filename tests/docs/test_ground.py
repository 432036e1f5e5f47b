"""The ground station's page of the documentation, command by command."""

import pytest

from tests.docs.tutorial import ROOT, follow


@pytest.mark.timeout(900)
def test_the_ground_station_is_tried_as_its_page_says(tmp_path):
    said = follow(ROOT / "docs/ground.md", tmp_path)
    assert "page at http://127.0.0.1:8460/" in said
    assert "closest drone" in said
    assert "<h1>Debriefing</h1>" in (tmp_path / "debrief.html").read_text()
