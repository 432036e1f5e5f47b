"""Edits of a drone's file leave everything else as it was."""

import difflib

import pytest
import yaml

from companion.settings.edit import as_block, edited

FILE = """\
# The first drone.
fileversion: 2
name: drone1   # painted on its arm
airframe: {name: quad5, hover_thrust: 0.36}   # weighed
camera:
  source: "device:0"
  fov_deg: 160   # as sold

  # The mount was printed.
mission: {goals: [[4, 0, 2],
                  [0, 0, 2]]}
timing:
"""


def test_edits_change_the_lines_of_their_keys_alone():
    changes = {
        ("airframe", "hover_thrust"): 0.31,
        ("airframe", "drag"): 0.2,
        ("camera", "fov_deg"): 154.3,
        ("camera", "mount_deg"): [1.5, -2.0, 0.25],
        ("timing", "delay"): 0.05,
        ("log", "path"): "a b's.mcap",
    }
    after = edited(FILE, changes)
    lines = [x for x in difflib.ndiff(FILE.splitlines(), after.splitlines()) if x[0] in "+-"]
    assert lines == [
        "- airframe: {name: quad5, hover_thrust: 0.36}   # weighed",
        "+ airframe: {name: quad5, hover_thrust: 0.31, drag: 0.2}   # weighed",
        "-   fov_deg: 160   # as sold",
        "+   fov_deg: 154.3   # as sold",
        "+   mount_deg: [1.5, -2, 0.25]",
        "- timing:",
        "+ timing: {delay: 0.05}",
        "+ log:",
        "+   path: 'a b''s.mcap'",
    ]
    data = yaml.safe_load(FILE)
    for (section, key), value in changes.items():
        data[section] = (data.get(section) or {}) | {key: value}
    assert yaml.safe_load(after) == data


@pytest.mark.parametrize(
    "before",
    [
        "airframe: quad5\n",
        "airframe: quad5  # short",
        "{airframe: quad5}",
        "",
        "camera:\n  mount_deg:\n    - 1\n    - 2\n    - 3\n  lag: 0\n",
        "camera:\n  mount_deg:\n    - 1\n    - 2\n    - 3\n",
        "camera:\n  deep:\n    deeper:\n      - {a: 1}\n",
        "camera: {}\nname: x",
        "camera:\nname: x\n",
    ],
)
def test_any_layout_reads_as_intended(before):
    changes = {("airframe", "drag"): 0.25, ("camera", "mount_deg"): [0.0, -3.25, 1e-05]}
    after = edited(before, changes)
    data = yaml.safe_load(before) or {}
    short = data.get("airframe")
    expected = {k: v for k, v in data.items() if v is not None}
    expected["airframe"] = ({"name": short} if short else {}) | {"drag": 0.25}
    expected["camera"] = (data.get("camera") or {}) | {"mount_deg": [0.0, -3.25, 1e-05]}
    loaded = yaml.safe_load(after)
    loaded["camera"]["mount_deg"] = [float(x) for x in loaded["camera"]["mount_deg"]]
    assert loaded == expected


def test_the_block_is_yaml_of_the_changes_alone():
    block = as_block({("camera", "lag"): -0.05, ("camera", "fov_deg"): 150.0})
    assert block == "camera:\n  lag: -0.05\n  fov_deg: 150\n"


def test_a_section_that_is_no_mapping_is_refused():
    with pytest.raises(ValueError, match="camera must hold keys"):
        edited("camera: 3\n", {("camera", "lag"): 0.1})
