"""What the supervisor, the journal and the lock are told, piece by piece."""

import errno
import logging
import socket
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from companion.perception.frontend import Detections
from companion.pipeline import TickOutputs
from companion.process import journal
from companion.process.directories import StateFile, log_path
from companion.process.liveness import Liveness
from companion.process.supervisor import Supervisor
from companion.process.vehicle_lock import VehicleLock, VehicleTaken
from companion.supervision.guard import Reason, Verdict
from mavlink_bridge.wire.messages import Heartbeat, RateCommand, VehicleState

OWN = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
HEARTBEAT = Heartbeat(12, 2, False, 0, 3)


def verdict(reason, bad_ticks=0):
    return Verdict(RateCommand(np.zeros(3), 9.81), reason, bad_ticks)


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


def test_ready_needs_heartbeat_frame_and_plan():
    vital = Liveness(0.1)
    vital.judge(TickOutputs(0.0), sent=False)
    assert not vital.ready
    assert vital.missing == (
        "waiting for heartbeat and telemetry of the autopilot, camera frame, solved plan"
    )
    vital.judge(TickOutputs(0.1, heartbeat=HEARTBEAT), sent=False)
    vital.judge(TickOutputs(0.2, sighting=Detections(0.2, OWN)), sent=False)
    assert not vital.ready
    assert vital.missing == "waiting for solved plan"
    vital.judge(TickOutputs(0.3, rehearsed=True), sent=False)
    assert vital.ready


@pytest.mark.parametrize(
    ("of_tick", "sent", "alive"),
    [
        (None, False, True),  # no stream: the tick came to its end
        (verdict(Reason.PLAN), True, True),
        (verdict(Reason.PLAN), False, False),  # solved, but nothing left the process
        (verdict(Reason.BRAKE, 25), True, True),  # a fallback may last 2.5 s
        (verdict(Reason.BRAKE, 26), True, False),
        (verdict(Reason.NO_STATE, 100), True, False),
    ],
)
def test_what_feeds_the_watchdog(of_tick, sent, alive):
    assert Liveness(0.1).judge(TickOutputs(0.0, verdict=of_tick), sent) is alive


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


def record(name, **fields):
    made = logging.LogRecord("companion", logging.WARNING, "", 0, name, None, None)
    made.fields = fields
    return made


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"phase": "fly"}, "<4>it phase=fly"),
        ({"text": 'two words, "quoted"'}, "<4>it text=\"two words, 'quoted'\""),
        ({"text": "line\nbreak"}, "<4>it text=line\\nbreak"),
        ({"t": 0.123456789}, "<4>it t=0.123457"),
        ({"text": ""}, '<4>it text=""'),
    ],
)
def test_a_log_line(fields, line):
    assert journal.Fields(prefix=True).format(record("it", **fields)) == line
    assert journal.Fields(prefix=False).format(record("it", **fields)) == line[3:]


def test_a_flood_is_counted_not_written():
    now = 0.0
    limit = journal.RateLimit(lambda: now)
    assert sum(limit.filter(record("flood")) for _ in range(1000)) == 5
    assert limit.filter(record("other"))
    now = 10.0
    after = record("flood")
    assert limit.filter(after)
    assert after.fields == {"suppressed": 995}


def test_where_the_log_goes():
    now = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)
    board = {"LOGS_DIRECTORY": "/var/log/x"}
    stamped = "flight-20260304T050607Z.mcap"
    assert log_path("flight-{time}.mcap", board, now) == Path("/var/log/x") / stamped
    assert log_path("flight-{time}.mcap", {}, now) == Path(stamped)
    assert log_path("/mnt/card/a.mcap", board, now) == Path("/mnt/card/a.mcap")


def test_the_state_file(tmp_path):
    state = StateFile({"RUNTIME_DIRECTORY": str(tmp_path)})
    assert state.write(phase="fly", armed=True)
    file = tmp_path / "state.json"
    assert '"armed": true' in file.read_text()
    first = file.stat().st_mtime_ns
    assert not state.write(phase="fly", armed=True)
    assert file.stat().st_mtime_ns == first
    StateFile({"RUNTIME_DIRECTORY": str(tmp_path / "gone")}).write(phase="fly")  # and no error
