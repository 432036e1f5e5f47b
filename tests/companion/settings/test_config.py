"""A drone's file: its layers, and mistakes with their line and column."""

import json
import random
from pathlib import Path

import pytest

from companion.settings.config import CompanionConfig, load_config
from mavlink_bridge.shared.settings import SettingsError, parse_yaml, validate

HEAD = "fileversion: 2\nname: one\n"

# Text below HEAD, line:column, what the message holds.
WRONG = [
    ("link:\n  systemid: 1\n", "4:3", "link.systemid: unknown key; did you mean 'system_id'?"),
    ("lnk: {}\n", "3:1", "lnk: unknown key; did you mean 'link'? valid: airframe, "),
    ("link:\n  system_id: 0\n", "4:3", "link.system_id: must be ≥ 1, ≤ 255, got 0"),
    ("link:\n  system_id: 256\n", "4:3", "link.system_id: must be ≥ 1, ≤ 255, got 256"),
    ("link:\n  system_id: 1.5\n", "4:3", "link.system_id: must be a whole number, ≥ 1, ≤ 255"),
    ("link:\n  system_id: 012\n", "4:3", "got '012'"),
    ("link: {system_id: 3, system_id: 4}\n", "3:22", "stands twice, first FILE:3:8"),
    ("link:\n  autopilot: px5\n", "4:3", "link.autopilot: must be 'px4'"),
    ("link:\n  endpoint: tcp:1\n", "4:3", "endpoint 'tcp:1' is none of: udpin:HOST:PORT, "),
    ("link:\n  endpoint: serial:/dev/ttyACM0:9\n", "4:3", "baud rate 9 is none of 9600"),
    (
        "link: udp\n",
        "3:1",
        "link: must hold `key: value` lines; valid: allow, autopilot, component_id",
    ),
    ("link:\n", "3:1", "link: must hold `key: value` lines"),
    ("name: two\n", "3:1", "name: stands twice, first FILE:2:1"),
    ("mission:\n  auto: no\n", "4:3", "mission.auto: must be true or false, got 'no'"),
    ("mission:\n  auto: 1\n", "4:3", "mission.auto: must be true or false, got 1"),
    ("mission:\n  auto: 'true'\n", "4:3", "mission.auto: must be true or false, got 'true'"),
    ("mission:\n  tolerance: .nan\n", "4:3", "must be a number, > 0, got '.nan'"),
    ("mission:\n  tolerance: .inf\n", "4:3", "must be a number, > 0, got '.inf'"),
    ("mission:\n  tolerance: !!float .nan\n", "4:3", "must be a finite number"),
    ("mission:\n  tolerance: 1e999\n", "4:3", "must be a finite number"),
    ("mission:\n  tolerance: '1.0'\n", "4:3", "must be a number, > 0, got '1.0'"),
    ("mission:\n  tolerance: 1_0\n", "4:3", "must be a number, > 0, got '1_0'"),
    ("mission:\n  goals: [[1, 2, 3], [1, 2]]\n", "4:22", "mission.goals.1: "),
    ("mission:\n  goals:\n    - [1, 2, 3]\n    - [1, x, 3]\n", "6:11", "mission.goals.1.1: "),
    ("mission:\n  goals: 3\n", "4:3", "mission.goals: must be a list, got 3"),
    ("guard: {c_min: 15.0}\n", "3:9", "guard.c_min: must be ≥ 0, < 9.80665, got 15"),
    ("guard: {stale_stop: 5.0}\n", "3:9", "guard.stale_stop: stale_land, 1, must be above"),
    ("guard: {stale_land: 0.3}\n", "3:9", "guard.stale_land: stale_land, 0.3, must be above"),
    ("speed_limits: {no_view: 0.7}\n", "3:16", "no_view, 0.7, must be above full_view"),
    ("nmpc:\n  N: 4\n", "4:3", "nmpc.N: M must be at most N"),
    ("nmpc:\n  M: 30\n", "4:3", "nmpc.M: M must be at most N"),
    ("nmpc:\n  penalty: -1\n", "4:3", "nmpc.penalty: must be > 0, got -1"),
    ("camera:\n  fov_deg: 400\n", "4:3", "camera.fov_deg: must be > 10, < 240, got 400"),
    ("camera:\n  source: usb0\n", "4:3", "camera.source: must be sim:HOST:PORT"),
    ("timing:\n  pace: fast\n", "4:3", "timing.pace: must be 'clock' or 'frames', got 'fast'"),
    ("airframe: quad7\n", "3:1", "airframe.name: unknown airframe 'quad7'; valid: quad5"),
    ("airframe: {hover_thrust: 33}\n", "3:12", "hover_thrust: must be ≥ 0.05, ≤ 0.8, got 33"),
    (
        "sensing: {trunks: {max_radius: 0.5}}\n",
        "3:20",
        "max_radius: radius, 1, must lie between min_radius, 0.08, and max_radius, 0.5",
    ),
    (
        "mission: {tolerance: 0.2, goals: [[1, 2, 3], [4, 2, 3]]}\n",
        "3:11",
        "mission.tolerance: between island and tolerance 0.07 m are left",
    ),
    ("guard: {bad_land: 2.5}\n", "3:9", "guard.bad_land: must be > 0, < 2.5, got 2.5"),
    ("link: {component_id: 1}\n", "3:8", "link.component_id: must be ≥ 2, ≤ 255, got 1"),
    ("timing: {period: 0.3}\n", "3:10", "timing.period: must be ≥ 0.02, ≤ 0.2, got 0.3"),
    ("nmpc: {planes: 1}\n", "3:8", "nmpc.planes: must be ≥ 2, ≤ 64, got 1"),
    ("nmpc: {omega_max: 0.01}\n", "3:8", "nmpc.omega_max: must be ≥ 0.5, got 0.01"),
    ("fence:\n\taltitude_min: 1\n", "4:1", "not YAML: "),
    ("fence: [1\n", "4:1", "not YAML: "),
    ("fence: &f {}\nlog: *f\n", "4:6", "aliases are not used here"),
    ("1: 2\n", "3:1", "a key must be a word"),
    ("log: !!python/object:os.system {}\n", "3:6", "not YAML: could not determine a constructor"),
    ("log: {path: !!int x}\n", "3:13", "not YAML: invalid literal for int()"),
    ("log: {path: \x00}\n", "3:13", "not YAML: special characters are not allowed"),
    ("nmpc: {N: %s}\n" % ("9" * 5000), "3:11", "not YAML: Exceeds the limit"),
    ("board: {host: 'a b'}\n", "3:9", "board.host: "),
    (
        "mission: {goals: [%s]}\n" % ("[1, 2, 2], " * 1001),
        "3:11",
        "mission.goals: must have at most",
    ),
    ("log: {path: 3}\n", "3:7", "log.path: must be text"),
]


@pytest.mark.parametrize(("text", "place", "what"), WRONG)
def test_each_mistake_is_named_with_line_and_column(check, text, place, what):
    check(text, place, what)


@pytest.mark.parametrize(
    ("text", "place", "what"),
    [
        ("name: one\n", "1:1", "fileversion: is missing; valid: 2"),
        ("fileversion: 1\n", "1:1", "fileversion: must be 2, got 1"),
        ("", "1:1", "fileversion: is missing"),
        ("- 1\n", "1:1", "the file must hold `key: value` lines"),
    ],
)
def test_the_file_as_a_whole(folder, text, place, what):
    file = folder / "one.yaml"
    file.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    assert caught.value.problems == [f"{file}:{place}: {what}"] or what in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_file_that_is_too_large_is_refused_before_it_is_read(folder, monkeypatch):
    file = folder / "one.yaml"
    file.write_text("fileversion: 2\nmission:\n  goals:\n" + "  - [1.0, 2.0, 2.0]\n" * 100_000)
    monkeypatch.setattr(Path, "read_text", lambda *a, **k: pytest.fail("read"))
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    assert caught.value.problems == [f"{file}: must have at most 262144 bytes, got 2000033"]


def test_all_mistakes_of_all_layers_come_at_once(folder):
    (folder / "default.yaml").write_text("mission: {auto: no}\nfence: {top: 1}\n")
    file = folder / "one.yaml"
    file.write_text("fileversion: 2\nlink: {system_id: 0}\nlink: {system_id: 0}\nlgo: {}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    places = [p.split(": ")[0].removeprefix(f"{folder}/") for p in caught.value.problems]
    assert sorted(places) == [
        "default.yaml:1:1",
        "default.yaml:1:11",
        "default.yaml:2:9",
        "one.yaml:3:1",
        "one.yaml:3:8",
        "one.yaml:4:1",
    ]


def test_layers_lie_over_each_other(folder):
    (folder / "default.yaml").write_text("fileversion: 2\nmission: {tolerance: 2.0}\n")
    file = folder / "one.yaml"
    file.write_text(HEAD + "airframe: {name: quad5, radius: 0.3}\ncamera: {calibration: c.yaml}\n")
    config = load_config(file, ["mission.takeoff_altitude=3.0"])
    assert config.mission.tolerance == 2.0
    assert config.mission.takeoff_altitude == 3.0
    assert (config.airframe.hover_thrust, config.airframe.radius) == (0.4, 0.3)
    assert config.camera.calibration == str(folder / "c.yaml")


def test_any_damage_to_a_file_is_a_named_mistake():
    whole = CompanionConfig(fileversion=2).model_dump(mode="json")
    rng = random.Random(1)
    found = [problems_of(json.dumps(broken(whole, rng))) for _ in range(60)]
    assert sum(map(bool, found)) > 20
    assert all(problem.startswith("f:1:") for problems in found for problem in problems)


def problems_of(text):
    try:
        validate(CompanionConfig, parse_yaml(text, "f"), "f")
    except SettingsError as error:
        return error.problems
    return []


def broken(node, rng):
    """A copy of a document in which something deep down is gone, renamed, or of another kind."""
    node = dict(node)
    key = rng.choice(list(node))
    value = node.pop(key)
    if value and isinstance(value, dict) and rng.random() < 0.8:
        return node | {key: broken(value, rng)}
    strange = [None, True, "x", -1, 1e300, [], {}, [1], [[1, 2]], {"a": {"b": 1}}]
    change = rng.choice(["gone", "renamed", "other"])
    return node | {"renamed": {"x": value}, "other": {key: rng.choice(strange)}}.get(change, {})
