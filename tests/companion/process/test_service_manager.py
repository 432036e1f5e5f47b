"""Notices to the service manager."""

import socket

import pytest

from companion.process.service_manager import ServiceManager


@pytest.mark.parametrize("abstract", [False, True])
def test_notifications_are_datagrams(tmp_path, abstract):
    address = f"@companion-test-{tmp_path.name}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + address[1:] if abstract else address)
        service_manager = ServiceManager({"NOTIFY_SOCKET": address})
        service_manager.ready("fly")
        service_manager.alive()
        assert listener.recv(4096) == b"READY=1\nSTATUS=fly\nWATCHDOG=1"
        assert listener.recv(4096) == b"WATCHDOG=1"
        service_manager.close()


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/nowhere/at/all"}])
def test_without_a_listener_nothing_happens(environment):
    service_manager = ServiceManager(environment)
    service_manager.alive()
    service_manager.close()
    service_manager.alive()
