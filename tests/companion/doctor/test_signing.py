"""What the doctor finds out about signatures: a vehicle that checks them, one that does not.

The vehicle answers from a thread of its own, as from the other end of a network.
"""

import threading
from contextlib import closing
from datetime import UTC, datetime

import pytest

from companion.doctor import signing, vehicle
from companion.doctor.finding import Level
from companion.settings.config import CompanionConfig
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import AutopilotVersion, Command, CommandAck, Heartbeat
from mavlink_bridge.wire.signing import Signing, timestamp_at
from mavlink_bridge.wire.udp import UdpEndpoint
from tests.companion.deployment import free_ports

KEY = bytes(range(32))


class Vehicle:
    """An autopilot that beats, and answers what it accepts; key: it checks signatures."""

    def __init__(self, port, key):
        now = signing_time()
        codec = Codec(1, 1, signing=None if key is None else Signing(key, now))
        self.link = Link(UdpEndpoint(remote=("127.0.0.1", port)), codec)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._end.is_set():
            self.link.send([Heartbeat(12, 2, False, 0, 4)])
            self.link.wait(0.05)
            for r in self.link.receive():
                if isinstance(r.message, Command):
                    self.link.send([CommandAck(r.message.command, 0, 1, 191)])
                    self.link.send([AutopilotVersion(8, 0x010F00FF, 77)])

    def close(self):
        self._end.set()
        self._thread.join()
        self.link.close()


def signing_time():
    return timestamp_at(datetime.now(UTC).timestamp())


@pytest.fixture
def examined(tmp_path, monkeypatch):
    """Findings of the doctor by name, about a vehicle with this key."""
    monkeypatch.setattr(vehicle, "_LISTEN", 2.5)
    monkeypatch.setattr(signing, "_ATTEMPTS", 3)
    file = tmp_path / "signing.key"
    file.write_text(KEY.hex())
    file.chmod(0o600)

    def examine(key, ours=True, host="127.0.0.1"):
        port = free_ports(1)
        link = {"endpoint": f"udpin:{host}:{port}", "system_id": 1}
        if ours:
            link["signing"] = {"key": str(file)}
        with closing(Vehicle(port, key)):
            found = list(vehicle.examine(CompanionConfig(link=link), hover_known=True))
        return {f.name: f for f in found}

    return examine


def test_an_autopilot_that_obeys_unsigned_commands_is_red(examined):
    finding = examined(key=None)["signing"]
    assert finding.level is Level.RED
    assert "obeys commands that are not signed" in finding.text
    assert "SETUP_SIGNING" in finding.todo


def test_an_autopilot_that_checks_signatures_is_green_and_is_examined_signed(examined):
    found = examined(key=KEY)
    assert found["signing"].level is Level.GREEN
    assert "no version" not in found["vehicle"].text  # it has answered the signed request


@pytest.mark.parametrize(("host", "red"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_without_a_key_a_vehicle_on_a_network_is_red(examined, host, red):
    found = examined(key=None, ours=False, host=host)
    assert ("signing" in found) == red
    if red:
        assert found["signing"].level is Level.RED
        assert "link.signing" in found["signing"].todo
