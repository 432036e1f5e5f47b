"""One daemon for each vehicle."""

import errno
import socket

import pytest

from companion.process.vehicle_lock import VehicleLock, VehicleTaken


def test_a_vehicle_is_flown_once(tmp_path):
    lock = VehicleLock(f"{tmp_path.name}#1")
    with pytest.raises(VehicleTaken, match=r"flown by another daemon already, process \d+"):
        VehicleLock(f"{tmp_path.name}#1")
    VehicleLock(f"{tmp_path.name}#2").close()
    lock.close()
    VehicleLock(f"{tmp_path.name}#1").close()


def test_a_long_name_is_locked_too_and_only_what_is_held_is_taken(monkeypatch):
    name = f"serial:/dev/serial/by-id/{'long-' * 40}if00:921600#1"
    lock = VehicleLock(name)
    with pytest.raises(VehicleTaken, match="by-id"):
        VehicleLock(name)
    lock.close()

    def refused(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refused)
    with pytest.raises(PermissionError, match="Permission denied"):
        VehicleLock(name)
