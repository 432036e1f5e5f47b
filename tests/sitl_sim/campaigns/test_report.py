"""All runs of a campaign on one page."""

import json
import re

import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns.run import metrics_of


def write_runs(folder, good, bad):
    for n in range(good + bad):
        run = folder / f"forest-{n}"
        run.mkdir(parents=True)
        metrics = {
            "ok": n < good,
            "seed": n,
            "scenario": "forest",
            "drones": 9,
            "agent_collisions": int(n >= good),
            "obstacle_collisions": 0,
            "min_agent_distance_m": 0.3 + 0.1 * n,
            "min_obstacle_distance_m": 0.5,
            "mean_speed_m_s": 1.4,
            "duration_s": 90.0 + n,
        }
        (run / "metrics.json").write_text(json.dumps(metrics))
        if n != 1:  # the page links to those that are there
            (run / "report.html").write_text("")


def test_all_runs_on_one_page(tmp_path, capsys):
    write_runs(tmp_path / "campaign", good=7, bad=1)
    assert main(["report", str(tmp_path / "campaign")]) == 0
    path = tmp_path / "campaign" / "campaign.html"
    assert capsys.readouterr().out.strip() == str(path)
    page = path.read_text()
    assert "<b>7 of 8</b> <span>flights reached all targets" in page
    assert "87.5%, 95 % interval 52.9% to 97.8%" in page
    assert (tmp_path / "campaign" / "plotly.min.js").stat().st_size > 1e6
    assert page.count("<b class=good>OK</b>") == 7
    assert "<a href='forest-3/report.html'>forest-3</a>" in page
    assert "<a href='forest-1/'>forest-1</a>" in page


def test_an_infinite_distance_of_an_earlier_version_is_none(tmp_path):
    write_runs(tmp_path, good=3, bad=0)
    path = tmp_path / "forest-1" / "metrics.json"
    path.write_text(path.read_text().replace("0.4", "Infinity"))
    assert metrics_of(path.parent)["min_agent_distance_m"] is None
    assert main(["report", str(tmp_path)]) == 0
    assert "inf" not in re.findall("<td>([^<]*)", (tmp_path / "campaign.html").read_text())


@pytest.mark.parametrize("content", ["", "[]", "{}", "no json"])
def test_foreign_metrics_are_one_clear_line_and_status_2(tmp_path, capsys, content):
    write_runs(tmp_path, good=2, bad=0)
    (tmp_path / "forest-1" / "metrics.json").write_text(content)
    assert main(["report", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "forest-1/metrics.json" in lines[0]
