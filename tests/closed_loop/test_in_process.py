"""Companions in the simulator's process fly as companions in processes of their own."""

import json

from sitl_sim.__main__ import main

SCENARIO = """
fileversion: 1
name: pair
seed: 3
world: {cylinders: [{x: 3.0, y: 0.4, radius: 0.5}], boxes: [{min: [-1, 4, 0], max: [9, 5, 5]}]}
drones: {count: 2, spacing: 1.5, heading_deg: 0.0, frame_yaw_deg: random}
mission: {targets: [[8.0, 0.0, 2.0]], home: false, tolerance: 2.0, time_limit: 9.0}
sensing: {neighbours: truth, obstacles: map}
wire: {companion_port: 27540, gcs_port: 27550, frame_port: 27640}
"""


def test_both_ways_to_run_the_companions_give_the_same_truth(tmp_path):
    file = tmp_path / "pair.yaml"
    file.write_text(SCENARIO)
    ways = {"processes": [], "one": ["--in-process"]}
    found = {}
    for way, options in ways.items():
        main(["run", str(file), "--out", str(tmp_path / way), *options])
        found[way] = json.loads((tmp_path / way / "metrics.json").read_text())
    assert found["one"]["truth_sha256"] == found["processes"]["truth_sha256"]
    assert found["one"]["duration_s"] > 8.0
    assert found["one"]["never_flew"] == []
    assert found["one"]["solve_ms"]["p50"] > 0.0  # the logs are kept as well
