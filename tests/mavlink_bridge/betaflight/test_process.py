"""`mavlink-bridge` from the command line: exit statuses, and one line for each failure."""

import pytest

from mavlink_bridge.__main__ import main


def run(tmp_path, text):
    """Return the exit status for a configuration."""
    file = tmp_path / "bridge.yaml"
    file.write_text(f"fileversion: 1\n{text}")
    return main(["betaflight", str(file)])


def test_a_missing_device_exits_with_69_to_be_tried_again(tmp_path, capsys):
    assert run(tmp_path, "controller: serial:/dev/no-such-tty:115200\n") == 69
    said = capsys.readouterr().err
    assert said.startswith("serial /dev/no-such-tty: ")
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("controller: udpin:127.0.0.1:5761\n", "2:1", "controller: must be serial:DEVICE:BAUD or"),
        ("controller: ttyACM0\n", "2:1", "controller: endpoint 'ttyACM0' is none of: udpin:"),
        (
            "controller: serial:/dev/x:115201\n",
            "2:1",
            "controller: serial /dev/x: baud rate",
        ),
        ("link: {endpoint: nowhere}\n", "2:8", "link.endpoint: endpoint 'nowhere' is none of"),
        ("link: {ground: 'udpout:h:²'}\n", "2:8", "link.ground: endpoint 'udpout:h:²' is none of"),
        ("link: {gps: 'udpin:h'}\n", "2:8", "link.gps: endpoint 'udpin:h' is none of"),
    ],
)
def test_a_bad_endpoint_exits_with_2(tmp_path, capsys, text, where, what):
    assert run(tmp_path, text) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path}/bridge.yaml:{where}: {what}")
    assert len(said.splitlines()) == 1
