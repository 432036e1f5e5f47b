"""MAVProxy, unmodified from PyPI, with a pilot's commands, on the ground station's port."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

from tests.wire.served import Lines, served

# Parameters, one of them to set, before the take-off, and how to land. MAVProxy 1.8.75 cannot
# set PX4's modes by name (it sends the whole triple as one number), so there a command lands.
WAYS = {
    "px4": (
        33,
        ("COM_OBL_RC_ACT", 5),
        "param set MIS_TAKEOFF_ALT 5",
        "long NAV_LAND 0 0 0 0 0 0 0",
    ),
    "ardupilot": (22, ("GUID_OPTIONS", 8), "mode guided", "mode land"),
}
ANYTHING = ""


class Console:
    """A running MAVProxy."""

    def __init__(self, process):
        self._process = process
        self.lines = Lines(process.stdout)

    def type(self, command, answer, timeout=60.0):
        """Type a command and wait for its result in the output."""
        since = len(self.lines.text)
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return self.lines.wait_for(answer, since, timeout)

    def until(self, command, answer, tries=60):
        """Type a command again each second until the answer is right."""
        for _ in range(tries - 1):
            with contextlib.suppress(TimeoutError):
                return self.type(command, answer, timeout=1.0)
        return self.type(command, answer, timeout=1.0)


@contextlib.contextmanager
def mavproxy(port, folder):
    process = subprocess.Popen(
        [
            sys.executable,
            str(Path(sys.executable).parent / "mavproxy.py"),
            f"--master=udpin:127.0.0.1:{port}",
            f"--state-basedir={folder}",
            "--default-modules=link,arm,mode,param,wp,misc,cmdlong,rc",
            "--source-system=250",
        ],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    console = Console(process)
    try:
        yield console
    finally:
        process.stdin.close()
        process.terminate()
        process.wait(timeout=20)
        console.lines.join()


@pytest.mark.slow
@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_mavproxy_flies(flavour, tmp_path):
    count, (name, value), before, landing = WAYS[flavour]
    with served(flavour) as world, mavproxy(world.gcs, tmp_path) as console:
        console.lines.wait_for(rf"Received {count} parameters")
        console.type(f"param set {name} {value}", ANYTHING)
        console.until(f"param show {name}", rf"{name}\s+{value}(\.0)?\s")
        console.type(before, ANYTHING)
        console.type("arm throttle", r"\bARMED")
        console.type("takeoff 5", "NAV_TAKEOFF: ACCEPTED")
        console.until("status GLOBAL_POSITION_INT", r"relative_alt : (4[789]|5[012])\d\d\D")
        console.type(landing, "Landing detected")
        console.type("status HEARTBEAT", r"Disarmed|DISARMED")
