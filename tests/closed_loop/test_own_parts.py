"""The example package outside the repository: its parts fly in processes, in one, in a campaign."""

import json
import os
import sys

import numpy as np
import pytest

import sitl_sim
from sitl_sim.__main__ import main
from tests.own_parts import EXAMPLE, install

SHORT = ["--set", "mission.time_limit=6", "--set", "wire.companion_port=28540"]
PORTS = ["--set", "wire.gcs_port=28550", "--set", "wire.frame_port=28640"]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    folder = install(tmp_path / "site")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    yield folder
    sys.modules.pop("own_parts", None)


def test_own_parts_fly_in_processes_and_in_one_alike(installed, tmp_path):
    file, found = str(EXAMPLE / "avenue.yaml"), {}
    for way, options in {"processes": [], "one": ["--in-process"]}.items():
        main(["run", file, *SHORT, *PORTS, "--out", str(tmp_path / way), *options])
        found[way] = json.loads((tmp_path / way / "metrics.json").read_text())
    assert found["one"]["truth_sha256"] == found["processes"]["truth_sha256"]
    assert found["one"]["never_flew"] == []
    assert found["one"]["controller"] == "keep-right"
    world = json.loads((tmp_path / "one" / "world.json").read_text())
    assert len(world["cylinders"]) == 8  # the avenue's


def test_own_parts_fly_to_their_targets_in_a_campaign_of_four(installed, tmp_path):
    many = sitl_sim.campaign(EXAMPLE / "avenue.yaml", runs=4, workers=2, out=tmp_path / "all")
    assert many.summary["not_flown"] == {}
    np.testing.assert_array_equal(many.array("ok"), [1.0, 1.0, 1.0, 1.0])
