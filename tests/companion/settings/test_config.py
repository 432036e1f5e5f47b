"""A drone's files: layers, and thirty mistakes with the line and column of each."""

import json
import random

import pytest

from companion.__main__ import main
from companion.settings.config import CompanionConfig, load_config
from companion.settings.packaged import data_folder
from mavlink_bridge.shared.settings import SettingsError, parse_yaml, validate

HEAD = "fileversion: 2\nname: one\n"  # two lines: what is wrong starts on line 3

WRONG = [
    # text below HEAD, line:column, what the message holds
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
    ("mission:\n  takeoff_altitude: 9.0\n", "4:3", "takeoff_altitude must lie inside the fence"),
    ("mission:\n  goals: [[1, 2, 3], [1, 2, 9]]\n", "4:22", "the goal, 9 m high, must lie inside"),
    (
        "mission:\n  level: 2.5\n  goals: [[1, 2, 3]]\n",
        "5:11",
        "mission.goals.0: the way to it, 5.5 m high, must lie inside the fence",
    ),
    (
        "fence:\n  altitude_min: 6.0\n",
        "4:3",
        "fence.altitude_min: altitude_max must be above altitude_min",
    ),
    (
        "fence: {east: [-5, 5]}\nmission:\n  goals: [[1, 2, 3], [50, 2, 3]]\n",
        "5:22",
        "mission.goals.1: must lie inside fence.east, [-5.0, 5.0], got [50.0, 2.0, 3.0]",
    ),
    (
        "fence: {north: [3, 5]}\nmission: {goals: [[1, 2, 3]]}\n",
        "4:19",
        "mission.goals.0: must lie inside fence.north, [3.0, 5.0], got [1.0, 2.0, 3.0]",
    ),
    (
        "airframe: {radius: 0.8}\n",
        "3:12",
        "airframe.radius: nmpc.d_obstacle_safety, 0.6, from the drone's centre, must be above",
    ),
    ("nmpc: {d_obstacle_safety: 0.2}\n", "3:8", "must be above airframe.radius, 0.2"),
    (
        "airframe: {radius: 0.4}\n",
        "3:12",
        "airframe.radius: nmpc.d_agent_safety, 0.8, from centre to centre, must be above twice",
    ),
    (
        "timing: {period: 0.05}\n",
        "3:10",
        "timing.period: nmpc.dt, 0.1, must be timing.period, 0.05",
    ),
    ("nmpc:\n  dt: 0.2\n", "4:3", "nmpc.dt: nmpc.dt, 0.2, must be timing.period, 0.1"),
    (
        "timing: {period: 0.2}\nnmpc: {dt: 0.2}\n",
        "3:10",
        "timing.period: guard.late, 0.15, must be above timing.period, 0.2",
    ),
    ("guard: {c_min: 15.0}\n", "3:9", "guard.c_min: must be ≥ 0, < 9.81, got 15"),
    (
        "guard: {c_min: 3.0}\n",
        "3:9",
        "guard.c_min: guard.c_min, 3, must be at most nmpc.c_min, 2, or the guard clips plans",
    ),
    (
        "nmpc: {c_max: 25.0}\n",
        "3:8",
        "nmpc.c_max: guard.c_max, 20, must be at least nmpc.c_max, 25",
    ),
    (
        "nmpc: {omega_max: 4.0}\nguard: {omega_max: 3.5}\n",
        "4:9",
        "guard.omega_max: guard.omega_max, 3.5, must be at least nmpc.omega_max, 4",
    ),
    ("guard: {stale_stop: 5.0}\n", "3:9", "guard.stale_stop: stale_land, 1, must be above"),
    ("guard: {stale_land: 0.3}\n", "3:9", "guard.stale_land: stale_land, 0.3, must be above"),
    ("speed_limits: {no_view: 0.7}\n", "3:16", "no_view, 0.7, must be above full_view"),
    ("nmpc:\n  N: 4\n", "4:3", "nmpc.N: M must be at most N"),
    ("nmpc:\n  M: 30\n", "4:3", "nmpc.M: M must be at most N"),
    ("nmpc:\n  penalty: -1\n", "4:3", "nmpc.penalty: must be > 0, got -1"),
    ("camera:\n  fov_deg: 400\n", "4:3", "camera.fov_deg: must be > 10, < 240, got 400"),
    ("camera:\n  source: usb0\n", "4:3", "camera.source: must be sim:HOST:PORT"),
    (
        "camera: {latency: 0.3}\n",
        "3:10",
        "every frame is late: camera.latency, 0.3, must be below camera_health.late, 0.18",
    ),
    (
        "sensing: {trunks_every: 8}\n",
        "3:11",
        "sensing.trunks_every: trunks would be forgotten between two looks",
    ),
    ("timing:\n  pace: fast\n", "4:3", "timing.pace: must be 'clock' or 'frames', got 'fast'"),
    ("airframe: quad7\n", "3:1", "airframe.name: unknown airframe 'quad7'; valid: quad5"),
    ("airframe: {hover_thrust: 33}\n", "3:12", "hover_thrust: must be ≥ 0.05, ≤ 0.8, got 33"),
    (
        "fence: {altitude_band: 0.1}\n",
        "3:9",
        "fence.altitude_band: altitude_band, 0.1, must be at least nmpc.d_obstacle_safety, 0.6",
    ),
    (
        "fence: {altitude_max: 1.9}\nmission: {takeoff_altitude: 1.5}\n",
        "3:9",
        "fence.altitude_max: altitude_max must be above altitude_min by twice nmpc.d_obst",
    ),
    ("fence: {east: [0, 1.1]}\n", "3:9", "fence.east: must be wider than twice nmpc.d_obstacle"),
    (
        "fence: {east: [-5, 5]}\nmission:\n  goals: [[1, 2, 3], [5, 2, 3]]\n",
        "5:22",
        "mission.goals.1: must lie 0.35 m inside the fence, [-5.0, 5.0], or it is never reached",
    ),
    ("mission: {goals: [[1, 2, 1.1]]}\n", "3:19", "must lie 0.35 m inside the fence, [0.8, 5.0]"),
    (
        "camera: {source: 'device:0'}\nsensing: {neighbours: truth}\n",
        "4:11",
        "sensing.neighbours: neighbours: truth needs the simulator as source; a camera has",
    ),
    (
        "camera: {source: 'device:0'}\nsensing: {obstacles: depth}\n",
        "4:11",
        "sensing.obstacles: obstacles: depth needs the simulator as source; a camera has",
    ),
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
    ("log: {path: 3}\n", "3:7", "log.path: must be text"),
]


@pytest.fixture
def folder(tmp_path):
    """A folder of drones with an airframe."""
    (tmp_path / "airframes").mkdir()
    (tmp_path / "airframes" / "quad5.yaml").write_text(
        "fileversion: 2\nairframe: {name: quad5, hover_thrust: 0.4}\n"
    )
    return tmp_path


@pytest.mark.parametrize(("text", "place", "what"), WRONG)
def test_each_mistake_is_named_with_line_and_column(folder, text, place, what):
    file = folder / "one.yaml"
    file.write_text(HEAD + text)
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    assert len(caught.value.problems) == 1, caught.value.problems
    problem = caught.value.problems[0]
    assert problem.startswith(f"{file}:{place}: ")
    assert what.replace("FILE", str(file)) in problem


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


def test_the_guard_may_be_wider_than_the_plan(folder):
    file = folder / "one.yaml"
    file.write_text(HEAD + "guard: {c_min: 1.0, c_max: 25.0, omega_max: 4.0}\n")
    assert load_config(file).guard.omega_max == 4.0


def test_layers_lie_over_each_other(folder):
    (folder / "default.yaml").write_text("fileversion: 2\nmission: {tolerance: 2.0}\n")
    file = folder / "one.yaml"
    file.write_text(HEAD + "airframe: {name: quad5, radius: 0.3}\ncamera: {calibration: c.yaml}\n")
    config = load_config(file, ["mission.takeoff_altitude=3.0"])
    assert config.mission.tolerance == 2.0
    assert config.mission.takeoff_altitude == 3.0
    assert (config.airframe.hover_thrust, config.airframe.radius) == (0.4, 0.3)
    assert config.camera.calibration == str(folder / "c.yaml")


@pytest.mark.parametrize(
    ("other", "key", "what"),
    [
        ("link: {system_id: 1, endpoint: 'udpin:127.0.0.1:1'}", "link.system_id", "system id 1"),
        ("link: {system_id: 2, endpoint: 'udpin:0.0.0.0:14541'}", "link.endpoint", "the port of"),
        ("name: one", "name", "the name 'one'"),
        ("camera: {source: 'sim:127.0.0.1:15541'}", "camera.source", "sim:127.0.0.1:15541"),
    ],
)
def test_two_drones_that_want_the_same(folder, capsys, other, key, what):
    name = "" if other.startswith("name") else "name: two\n"
    if "link" not in other:
        other += "\nlink: {system_id: 2, endpoint: 'udpin:127.0.0.1:1'}"
    if "camera" not in other:
        other += "\ncamera: {source: 'sim:127.0.0.1:1'}"
    (folder / "one.yaml").write_text(HEAD)
    (folder / "two.yaml").write_text(f"fileversion: 2\n{name}{other}\n")
    assert main(["check", str(folder / "one.yaml"), str(folder / "two.yaml")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{folder / 'two.yaml'}:")
    assert f": {key}: {what}" in lines[0]
    assert f"is taken by one ({folder / 'one.yaml'}" in lines[0]


@pytest.mark.parametrize(
    ("bridge", "what"),
    [
        ("link: {system_id: 7}\n", ":2:8: link.system_id: is 7, that of one 1"),
        ("link: {endpoint: 'udpout:127.0.0.1:9'}\n", ":2:8: link.endpoint: port 9, one listens on"),
        ("link: {endpoint: somewhere}\n", ":2:8: link.endpoint: endpoint 'somewhere' is none of"),
        ("controler: x\n", ":2:1: controler: unknown key; did you mean 'controller'?"),
        (
            "throttle: {hover: 0.5}\n",
            ":2:12: throttle.hover: is 0.5, airframe.hover_thrust of one 0.4",
        ),
        (
            "throttle: {exponent: 1.0, hover: 0.4}\n",
            ":2:12: throttle.exponent: is 1.0, airframe.thrust_exponent",
        ),
        ("link: {system_id: 1}\n", None),
    ],
)
def test_a_bridge_must_be_the_other_end(folder, capsys, bridge, what):
    (folder / "bridges").mkdir()
    throttle = "" if "throttle" in bridge else "throttle: {hover: 0.4}\n"
    (folder / "bridges" / "one.yaml").write_text(f"fileversion: 1\n{bridge}{throttle}")
    (folder / "one.yaml").write_text(
        HEAD + "airframe: {hover_thrust: 0.4, thrust_exponent: 1.75}\n"
    )
    status = main(["check", str(folder / "one.yaml"), str(folder / "bridges" / "one.yaml")])
    said = capsys.readouterr().err
    assert status == (2 if what else 0)
    assert said.startswith(f"{folder}/bridges/one.yaml{what}" if what else "")
    assert len(said.splitlines()) == bool(what)


def test_a_betaflight_is_not_signed_for(folder, capsys):
    drone = HEAD + "link: {{autopilot: {kind}, signing: {{key: autopilot.key}}}}\n"
    for kind in ("px4", "betaflight"):
        (folder / "one.yaml").write_text(drone.format(kind=kind))
        status = main(["check", str(folder / "one.yaml")])
        said = capsys.readouterr().err
        assert status == (2 if kind == "betaflight" else 0)
        assert ("one.yaml:3:31: link.signing: mavlink-bridge does not sign" in said) == bool(status)


def test_boards_have_ports_of_their_own(folder):
    drone = "fileversion: 2\nname: {n}\nlink: {{system_id: {n}}}\nboard: {{host: pi@drone{n}}}\n"
    for n in (1, 2):
        (folder / f"{n}.yaml").write_text(drone.format(n=n).replace("name: ", "name: d"))
    assert main(["check", str(folder / "1.yaml"), str(folder / "2.yaml")]) == 0


def test_check_for_machines(folder, capsys):
    (folder / "one.yaml").write_text(HEAD + "link: {system_id: 0}\n")
    assert main(["check", "--json", str(folder / "one.yaml")]) == 2
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    assert report["files"][0]["problems"] == [
        {
            "file": str(folder / "one.yaml"),
            "line": 3,
            "column": 8,
            "text": "link.system_id: must be ≥ 1, ≤ 255, got 0",
        }
    ]


def test_the_examples_are_fine_together(capsys):
    swarm = sorted(data_folder("configs/drones").glob("*.yaml"))
    assert len(swarm) >= 4
    assert main(["check", *map(str, swarm)]) == 0
    assert main(["check", str(data_folder("configs/drones/sitl") / "drone1.yaml")]) == 0


def test_show_is_yaml_that_says_where_each_value_came_from(folder, capsys):
    file = folder / "one.yaml"
    file.write_text(HEAD + "airframe: quad5\n")
    assert main(["config", "show", str(file), "--set", "nmpc.speed=1.25"]) == 0
    shown = capsys.readouterr().out
    lines = {line.split(":")[0].strip(): line for line in shown.splitlines()}
    assert lines["hover_thrust"].endswith(f"# {folder}/airframes/quad5.yaml:2:25")
    assert lines["speed"].endswith("# --set nmpc.speed=1.25")
    assert lines["fov_deg"].endswith("# built in")
    again = folder / "again.yaml"
    again.write_text(shown)
    assert load_config(again) == load_config(file, ["nmpc.speed=1.25"])


def test_show_for_machines(folder, capsys):
    (folder / "one.yaml").write_text(HEAD)
    assert main(["config", "show", "--json", str(folder / "one.yaml")]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["name"] == {"value": "one", "from": f"{folder / 'one.yaml'}:2:1"}


def test_examples_can_be_copied(tmp_path, capsys):
    assert main(["config", "examples", "--copy", str(tmp_path / "mine")]) == 0
    copied = capsys.readouterr().out.split()
    assert str(tmp_path / "mine" / "default.yaml") in copied
    assert main(["check", *(c for c in copied if "sitl" not in c)]) == 0
    assert main(["config", "examples", "--copy", str(tmp_path / "mine")]) == 2


def test_the_schema_describes_every_key(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["required"] == ["fileversion"]
    assert set(schema["properties"]) == set(CompanionConfig.model_fields)
    assert schema["$defs"]["LinkConfig"]["properties"]["system_id"]["maximum"] == 255
    assert schema["additionalProperties"] is False


def test_whatever_is_broken_is_a_mistake_with_a_name():
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
    if isinstance(value, dict) and rng.random() < 0.8:
        return node | {key: broken(value, rng)}
    strange = [None, True, "x", -1, 1e300, [], {}, [1], [[1, 2]], {"a": {"b": 1}}]
    change = rng.choice(["gone", "renamed", "other"])
    return node | {"renamed": {"x": value}, "other": {key: rng.choice(strange)}}.get(change, {})
