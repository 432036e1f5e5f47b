"""What the service manager is told."""

import socket

import pytest

from companion.process.supervisor import Supervisor


@pytest.mark.parametrize("abstract", [False, True])
def test_notifications_are_datagrams(tmp_path, abstract):
    address = f"@companion-test-{tmp_path.name}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + address[1:] if abstract else address)
        supervisor = Supervisor({"NOTIFY_SOCKET": address})
        supervisor.ready("fly")
        supervisor.alive()
        assert listener.recv(4096) == b"READY=1\nSTATUS=fly\nWATCHDOG=1"
        assert listener.recv(4096) == b"WATCHDOG=1"
        supervisor.close()


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/nowhere/at/all"}])
def test_nobody_listens_and_nothing_happens(environment):
    supervisor = Supervisor(environment)
    supervisor.alive()
    supervisor.close()
    supervisor.alive()
