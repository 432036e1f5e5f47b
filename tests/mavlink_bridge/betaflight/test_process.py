"""`mavlink-bridge` from the command line: exit statuses, and one line for each failure."""

import contextlib
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest

from mavlink_bridge.__main__ import main
from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.msp import Msp
from mavlink_bridge.betaflight.polling import POLLED
from tests.mavlink_bridge.betaflight.fake_controller import FakeController


def write(tmp_path, text):
    """Return a configuration file."""
    file = tmp_path / "bridge.yaml"
    file.write_text(f"fileversion: 1\n{text}")
    return file


def run(tmp_path, text):
    """Return the exit status for a configuration."""
    return main(["betaflight", str(write(tmp_path, text))])


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
        ("controller: serial:/dev/x:115201\n", "2:1", "controller: serial /dev/x: baud rate"),
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


def test_a_missing_file_and_a_bad_override_exit_with_2(tmp_path, capsys):
    assert main(["betaflight", str(tmp_path / "none.yaml")]) == 2
    assert (
        capsys.readouterr().err
        == f"{tmp_path}/none.yaml: cannot be read: No such file or directory\n"
    )
    assert main(["betaflight", str(write(tmp_path, "")), "--set", "nonsense"]) == 2
    assert capsys.readouterr().err == "--set nonsense: must be path.to.key=value\n"


@pytest.mark.parametrize("command", [[], ["betaflight"]])
def test_help_lists_the_exit_statuses(command, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([*command, "--help"])
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    for status in ("0", "1", "2", "69", "130"):
        assert f"\n  {status}  " in text


@contextlib.contextmanager
def bridge(tmp_path, port):
    """Run the bridge of the controller at this TCP port."""
    file = write(tmp_path, f"controller: tcp:127.0.0.1:{port}\nlink: {{ground: null}}\n")
    process = subprocess.Popen(
        [sys.executable, "-m", "mavlink_bridge", "betaflight", str(file)],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


class Server:
    """A controller on TCP that answers every request until the bridge ends."""

    def __init__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(20.0)
        self.port = self._listener.getsockname()[1]
        self.frames = []  # channels of each RC frame
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        fake, data = FakeController(), b""
        line, _ = self._listener.accept()
        with line, contextlib.suppress(ConnectionResetError):  # the bridge left answers unread
            while part := line.recv(4096):
                data += part
                while len(data) > 5 and len(data) >= (end := 6 + data[3]):
                    self._answer(line, fake, data[4], data[5 : end - 1])
                    data = data[end:]

    def _answer(self, line, fake, command, payload):
        if command == Msp.SET_RAW_RC:
            self.frames.append(struct.unpack("<16H", payload))
            return
        several = command == Msp.MULTIPLE_MSP
        answer = fake.several(POLLED).payload if several else fake.answer(command)
        with contextlib.suppress(OSError):  # the bridge has ended
            line.sendall(b"$M>" + msp.encode(command, answer)[3:])

    def close(self):
        self._thread.join()
        self._listener.close()


@pytest.mark.parametrize(
    ("number", "status", "last"),
    [(signal.SIGINT, 130, "interrupted\n"), (signal.SIGTERM, 0, "")],
)
def test_a_signal_ends_the_bridge_after_a_final_frame(tmp_path, number, status, last):
    server = Server()
    with bridge(tmp_path, server.port) as process:
        setup = [process.stderr.readline() for _ in range(4)]
        assert setup[0] == "Betaflight 4.6.0, MSP API 1.47\n"
        while not server.frames:
            time.sleep(0.01)
        process.send_signal(number)
        assert process.wait(timeout=10.0) == status
        assert process.stderr.read() == last
    server.close()
    assert server.frames[-1][:6] == (1500, 1500, 1000, 1500, 1000, 1900)


def test_ctrl_c_while_the_bridge_waits_for_its_controller_is_one_line(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.settimeout(20.0)
        with bridge(tmp_path, silent.getsockname()[1]) as process:
            line, _ = silent.accept()
            with line:
                process.send_signal(signal.SIGINT)
                assert process.wait(timeout=10.0) == 130
                assert process.stderr.read() == "interrupted\n"
