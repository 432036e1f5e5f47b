"""flights.parquet: a row for each flight, once, whatever happens while the campaign flies."""

import json
import re
from dataclasses import replace

import pyarrow.parquet
import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns import cost
from sitl_sim.campaigns.campaign import Campaign
from sitl_sim.campaigns.cost import Cost, cost_of, mean_cost, measured
from sitl_sim.campaigns.table import OF_FLIGHT, OF_WORKER, TABLE, Table

COST = Cost(worker="desk:7", version="0.1.0", wall_s=8.0, processor_s=4.0)
METRICS = {
    "ok": True, "truth_sha256": "ab", "drones": 2, "commit": "1234567", "controller": "nmpc",
    "agent_collisions": 0, "obstacle_collisions": 0, "ground_strikes": 0, "duration_s": 5.0,
    "min_agent_distance_m": 0.9, "min_obstacle_distance_m": None, "mission_time_s": None,
    "mean_speed_m_s": 1.0, "longest_standstill_s": 0.5, "longest_deadlock_s": 0.0,
    "solve_ms": {"p50": 1.5, "p99": 3.0}, "mission_complete": True, "targets_reached": {},
    "never_flew": [], "below_agent_safety": False, "below_obstacle_safety": False, "order": None,
    "union": None, "connectivity": None, "seed": 0, "faults_in_truth": [],
}  # fmt: skip


@pytest.fixture
def campaign(tmp_path):
    file = tmp_path / "hop.yaml"
    file.write_text("fileversion: 1\nname: hop\nmission: {targets: [[3.0, 0.0, 2.0]]}\n")
    return Campaign(str(file), [], 4, 0, tmp_path / "out", in_process=True)


def has_flown(campaign, seed, **changes):
    folder = campaign.run_folder(seed)
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text(json.dumps(METRICS | changes))
    (folder / "worker.json").write_text(json.dumps(vars(COST)))


def rows(campaign):
    return pyarrow.parquet.read_table(campaign.folder / TABLE).to_pylist()


def test_a_row_has_the_flight_and_its_worker(campaign):
    has_flown(campaign, 2, never_flew=["drone1"], ok=False)
    Table(campaign)
    (row,) = rows(campaign)
    assert list(row) == [*OF_FLIGHT, *OF_WORKER]
    assert (row["scenario"], row["seed"], row["truth_sha256"]) == ("hop", 2, "ab")
    assert (row["verdict"], row["why"]) == ("falls short", "never flew: drone1")
    assert (row["mission_time_s"], row["min_agent_distance_m"]) == (None, 0.9)
    assert (row["worker"], row["processor_s"], row["solve_p99_ms"]) == ("desk:7", 4.0, 3.0)
    about = pyarrow.parquet.read_schema(campaign.folder / TABLE).metadata[b"campaign"]
    assert json.loads(about)["name"] == "hop"


def test_the_table_grows_with_the_campaign_by_seed(campaign):
    has_flown(campaign, 3)
    table = Table(campaign)
    has_flown(campaign, 0)
    table.add(0, "OK")
    table.add(1, "KilledWorker: four workers died")
    table.write()
    found = [(row["seed"], row["verdict"], row["why"]) for row in rows(campaign)]
    assert found == [
        (0, "OK", None),
        (1, "not flown", "KilledWorker: four workers died"),
        (3, "OK", None),
    ]
    has_flown(campaign, 1)
    table.add(1, "OK")
    table.write()
    assert [row["verdict"] for row in rows(campaign)] == ["OK"] * 3


@pytest.mark.parametrize(("share", "seeds"), [(1e9, [0]), (1e-9, [])])
def test_a_flight_is_in_the_table_at_once_unless_writing_takes_too_long(
    campaign, monkeypatch, share, seeds
):
    monkeypatch.setattr("sitl_sim.campaigns.table._SHARE", share)
    campaign.folder.mkdir()
    table = Table(campaign)
    has_flown(campaign, 0)
    table.add(0, "OK")
    assert [row["seed"] for row in rows(campaign)] == seeds
    table.write()
    assert [row["seed"] for row in rows(campaign)] == [0]


def test_a_table_whose_writer_is_killed_stays_whole_and_is_made_up_for(campaign, monkeypatch):
    def killed(table, path):
        path.write_bytes(b"PAR1 and no more")
        raise KeyboardInterrupt

    has_flown(campaign, 0)
    Table(campaign)
    has_flown(campaign, 1)
    with monkeypatch.context() as patch:
        patch.setattr(pyarrow.parquet, "write_table", killed)
        with pytest.raises(KeyboardInterrupt):
            Table(campaign)
    assert [row["seed"] for row in rows(campaign)] == [0]
    Table(campaign)
    assert [row["seed"] for row in rows(campaign)] == [0, 1]


def test_a_finished_campaign_gets_its_table_later_and_then_keeps_it(campaign, capsys):
    command = ["campaign", campaign.scenario, "--out", str(campaign.folder), "--in-process"]
    has_flown(campaign, 0)
    assert main([*command, "--runs", "1"]) == 0
    assert not (campaign.folder / TABLE).exists()
    main([*command, "--runs", "1", "--table"])
    assert [row["seed"] for row in rows(campaign)] == [0]
    has_flown(campaign, 1)
    capsys.readouterr()
    main([*command, "--runs", "2"])
    assert [row["seed"] for row in rows(campaign)] == [0, 1]
    said = capsys.readouterr().out
    assert "4.00 / 8.00 s, mean" in said
    assert re.search("flights per core and hour +900.00", said)


def test_a_table_without_pyarrow_names_its_extra(campaign, monkeypatch, capsys):
    monkeypatch.setattr(
        "sitl_sim.commands.extras.find_spec", lambda name: None if name == "pyarrow" else name
    )
    assert main(["campaign", campaign.scenario, "--out", str(campaign.folder), "--table"]) == 2
    assert "pip install 'swarm-companion[export]'" in capsys.readouterr().err
    assert not campaign.folder.exists()


def test_the_cost_is_what_the_process_and_its_children_used(tmp_path, monkeypatch):
    used = iter([1.0, 4.5])
    monkeypatch.setattr(cost, "_processor_seconds", lambda: next(used))
    with measured(tmp_path):
        pass
    found = cost_of(tmp_path)
    assert found is not None
    assert found.processor_s == 3.5
    assert cost_of(tmp_path / "flown by an earlier version") is None


def test_a_mean_cost_counts_the_flights_that_tell_theirs():
    none = {"processor_s": None, "wall_s": None, "flights_per_core_hour": None}
    assert mean_cost([None]) == none
    found = mean_cost([COST, None, replace(COST, processor_s=6.0)])
    assert found == {"processor_s": 5.0, "wall_s": 8.0, "flights_per_core_hour": 720.0}
