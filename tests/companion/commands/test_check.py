"""`companion check`: for machines, and of the packaged examples."""

import json

from companion.__main__ import main
from companion.settings.packaged import data_folder


def test_check_for_machines(tmp_path, capsys):
    file = tmp_path / "one.yaml"
    file.write_text("fileversion: 2\nlink: {system_id: 0}\n")
    assert main(["check", "--json", str(file)]) == 2
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    assert report["files"][0]["problems"] == [
        {
            "file": str(file),
            "line": 2,
            "column": 8,
            "text": "link.system_id: must be ≥ 1, ≤ 255, got 0",
        }
    ]


def test_the_examples_are_fine_together(capsys):
    swarm = sorted(data_folder("configs/drones").glob("*.yaml"))
    assert len(swarm) >= 4
    assert main(["check", *map(str, swarm)]) == 0
    assert main(["check", str(data_folder("configs/drones/sitl") / "drone1.yaml")]) == 0
