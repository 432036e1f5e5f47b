"""The tutorials of the simulator, command by command; what they promise is there afterwards."""

import json

import pytest

from tests.docs.tutorial import ROOT, follow

pytestmark = pytest.mark.timeout(3600)  # nine flights
TUTORIALS = ROOT / "docs" / "tutorials"


def metrics(folder):
    return json.loads((folder / "metrics.json").read_text())


@pytest.mark.slow
def test_the_researcher_flies_a_controller_of_their_own_and_gets_figures(tmp_path):
    said = follow(TUTORIALS / "researcher.md", tmp_path)
    runs = tmp_path / "runs"
    assert metrics(runs / "magnetic")["controller"] == "magnetic"
    summary = json.loads((runs / "magnetic-4" / "summary.json").read_text())
    assert (summary["ok"], summary["runs"]) == (4, 4)
    campaign = (runs / "magnetic-4" / "campaign.html").read_text()
    for seed in range(4):  # each flown in processes of their own
        flight = runs / "magnetic-4" / f"clearing-{seed}"
        assert f"{flight.name}/report.html" in campaign
        assert (flight / "report.html").exists()
    assert (runs / "magnetic" / "figures" / "flight.pdf").read_bytes().startswith(b"%PDF")
    assert (runs / "magnetic" / "flight.mp4").stat().st_size > 10_000
    assert "controller=magnetic" in (tmp_path / "pages" / "compare.md").read_text()
    assert "did you mean 'magnetic'" in said
    assert "m between the drones at least" in said


def test_the_operator_sees_what_a_fault_did(tmp_path):
    said = follow(TUTORIALS / "operator.md", tmp_path)
    run = tmp_path / "runs" / "frozen"
    assert "camera_frozen" in (run / "report.html").read_text()
    assert (run / "swarm.mcap").stat().st_size > 100_000
    assert "ticks differ; first at tick" in said  # at another speed
