"""A flight debriefed from its log alone, whole or cut off."""

import json

import pytest
from mcap.writer import Writer

from companion.__main__ import main
from companion.bench.tick import stored
from companion.debrief.flight import Event, closest, read_flight, spans
from mavlink_bridge.shared.mcap_file import salvage

LOG = stored()


def tick(phase, tracks=(), p=(0.0, 0.0, 2.0)):
    told = [{"p": list(q), "unseen": u, "sigma": 0.1} for q, u in tracks]
    return {"phase": phase, "own": {"p": list(p)}, "tracks": told}


def test_the_closest_approach_is_that_in_flight_and_says_whether_it_was_seen():
    ticks = [
        tick("wait", [((0.1, 0.0, 2.0), 0.0)]),  # beside each other on the ground
        tick("fly", [((3.0, 0.0, 2.0), 0.0), ((0.0, 1.5, 2.0), 0.9)]),
        tick("fly", [((2.0, 0.0, 2.0), 0.0)]),
    ]
    found = closest([0.0, 0.1, 0.2], ticks)
    assert (found.distance, found.time, found.seen) == (1.5, 0.1, False)
    assert closest([0.0], ticks[:1]) is None


def test_what_lasts_is_told_with_its_begin_and_end():
    times = [0.0, 0.1, 0.2, 0.3]
    assert list(spans(times, ["plan", "plan", "blind", "plan"])) == [
        Event(0.0, 0.2, "plan"),
        Event(0.2, pytest.approx(0.1), "blind"),
        Event(0.3, 0.0, "plan"),
    ]


def test_a_recorded_flight_is_told():
    f = read_flight(LOG)
    assert f.name == "drone5"
    assert [e.what for e in f.phases] == ["arm", "takeoff", "engage", "fly"]
    assert f.flown == pytest.approx(f.phases[2].seconds + f.phases[3].seconds)
    assert 0.5 < f.approach.distance < 3.0
    assert f.stages["tick"][0] <= f.stages["tick"][1] <= f.stages["tick"][2]
    assert "flight" in f.estimates["hover thrust"]


def test_a_log_that_breaks_off_tells_what_it_holds(tmp_path):
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    with whole.open("wb") as file:
        writer = Writer(file, chunk_size=10_000)  # in many chunks, as a daemon writes it
        writer.start()
        channel = writer.register_channel("/tick", "json", 0)
        for m in salvage(LOG, "/tick"):
            writer.add_message(channel, m.log_time, m.data, m.publish_time)
        writer.finish()
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    whole, part = read_flight(whole), read_flight(cut)
    assert (whole.whole, part.whole) == (True, False)
    assert 1.0 < part.seconds < whole.seconds


def test_an_estimate_that_is_not_known_is_told_so(tmp_path):
    """A log has null where a number is not finite: the lag of a camera that was never turned."""
    (record,) = [json.loads(m.data) for m in salvage(LOG, "/tick")[-1:]]
    record["alignment"] |= {"lag": None, "sigmas": [None] * 5}
    record["delay"][1] = None
    log = tmp_path / "log.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/tick", "json", 0)
        writer.add_message(channel, 0, json.dumps(record).encode(), 0)
        writer.finish()
    estimates = read_flight(log).estimates
    assert estimates["camera lag"] == "unknown"
    assert "no doubt known" in estimates["delay"]


def test_the_command_writes_a_table_a_page_and_json(tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["debrief", str(LOG), "--html", str(page)]) == 0
    assert "closest drone" in capsys.readouterr().out
    assert "<h2>drone5</h2>" in page.read_text()
    assert main(["debrief", str(LOG), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["name"] == "drone5"


def test_what_is_no_log_is_one_line_and_the_others_are_told(tmp_path, capsys):
    (tmp_path / "foreign.mcap").write_text("nothing")
    assert main(["debrief", str(tmp_path / "foreign.mcap"), str(LOG)]) == 2
    told = capsys.readouterr()
    assert told.err == f"{tmp_path}/foreign.mcap: not an MCAP file\n"
    assert "drone5" in told.out
