"""`companion config`: where each value came from, and the packaged examples."""

import json

from companion.__main__ import main
from companion.settings.config import load_config


def test_show_is_yaml_that_says_where_each_value_came_from(tmp_path, capsys):
    (tmp_path / "airframes").mkdir()
    airframe = tmp_path / "airframes" / "quad5.yaml"
    airframe.write_text("fileversion: 2\nairframe: {name: quad5, hover_thrust: 0.4}\n")
    file = tmp_path / "one.yaml"
    file.write_text("fileversion: 2\nairframe: quad5\n")
    assert main(["config", "show", str(file), "--set", "nmpc.speed=1.25"]) == 0
    shown = capsys.readouterr().out
    lines = {line.split(":")[0].strip(): line for line in shown.splitlines()}
    assert lines["hover_thrust"].endswith(f"# {airframe}:2:25")
    assert lines["speed"].endswith("# --set nmpc.speed=1.25")
    assert lines["fov_deg"].endswith("# built in")
    again = tmp_path / "again.yaml"
    again.write_text(shown)
    assert load_config(again) == load_config(file, ["nmpc.speed=1.25"])


def test_show_for_machines(tmp_path, capsys):
    file = tmp_path / "one.yaml"
    file.write_text("fileversion: 2\nname: one\n")
    assert main(["config", "show", "--json", str(file)]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["name"] == {"value": "one", "from": f"{file}:2:1"}


def test_examples_can_be_copied(tmp_path, capsys):
    assert main(["config", "examples", "--copy", str(tmp_path / "mine")]) == 0
    copied = capsys.readouterr().out.split()
    assert str(tmp_path / "mine" / "default.yaml") in copied
    assert main(["check", *(c for c in copied if "sitl" not in c)]) == 0
    assert main(["config", "examples", "--copy", str(tmp_path / "mine")]) == 2
