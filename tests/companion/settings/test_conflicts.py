"""Drones that claim the same thing, and bridges that do not fit their drones."""

import pytest

from companion.__main__ import main

HEAD = "fileversion: 2\nname: one\n"


@pytest.mark.parametrize(
    ("other", "key", "what"),
    [
        ("link: {system_id: 1, endpoint: 'udpin:127.0.0.1:1'}", "link.system_id", "system id 1"),
        ("link: {system_id: 2, endpoint: 'udpin:0.0.0.0:14541'}", "link.endpoint", "the port of"),
        ("name: one", "name", "the name 'one'"),
        ("camera: {source: 'sim:127.0.0.1:15541'}", "camera.source", "sim:127.0.0.1:15541"),
    ],
)
def test_two_drones_that_claim_the_same_thing(folder, capsys, other, key, what):
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


def test_a_drone_with_a_bridge_cannot_sign(folder, capsys):
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
