"""The daemon as a service manager sees it: real processes, an emulated vehicle on the link."""

import os
import re
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from companion.flightlog.reader import read_log
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.shared.mcap_file import salvage
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Heartbeat
from mavlink_bridge.wire.udp import UdpEndpoint
from mavlink_bridge.wire.video import FrameServer
from tests.companion.patience import PATIENCE

WATCHDOG = 1.0  # s, as in the unit


@pytest.mark.row("24")
def test_ready_watchdog_and_an_orderly_end_in_flight(world, start_daemon):
    ground = UdpEndpoint(local=("127.0.0.1", world.ground_port))
    daemon = start_daemon(world.config(1, auto=True))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    before_ready = [line for _, line in daemon.heard if line.startswith("WATCHDOG")]
    assert not before_ready[1:], "the watchdog is not fed before READY"
    daemon.until_phase("fly")

    heard = daemon.count("WATCHDOG=1")
    until_fed(daemon, 20)
    fed = daemon.count("WATCHDOG=1") - heard

    before = cpu_seconds(daemon.process.pid)
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.listen(PATIENCE, until="STOPPING=1")
    _, status, used = os.wait4(daemon.process.pid, 0)
    daemon.process.returncode = os.waitstatus_to_exitcode(status)
    assert daemon.process.returncode == 0
    # 2 s, by its own ticks and by processor time: however loaded the machine is.
    (log,) = daemon.folder.glob("flight-*.mcap")
    flight = read_log(log)
    leaving = [i.leave for i in flight.inputs]
    assert 1 <= sum(leaving) <= 20
    assert leaving == sorted(leaving)
    assert used.ru_utime + used.ru_stime - before <= 2.0
    # At least twice in the watchdog's time: by the ticks, ten a second where none is missed.
    flown = [
        t for t, off in zip(flight.ticks, leaving, strict=True) if t["phase"] == "fly" and not off
    ]
    assert fed >= 2 / WATCHDOG * 0.1 * len(flown)
    assert vehicle_mode(ground, 1) == (True, "hold")
    assert "stopped" in daemon.log()
    assert "vehicle's address address=127.0.0.1:" in daemon.log()
    ground.close()


def until_fed(daemon, times):
    """Wait until the daemon has fed its watchdog so many times more."""
    enough = daemon.count("WATCHDOG=1") + times
    while daemon.count("WATCHDOG=1") < enough:
        assert daemon.listen(PATIENCE, until="WATCHDOG=1"), daemon.log()


def vehicle_mode(ground, system):
    """Return (armed, mode) of the latest heartbeat that a ground station hears."""
    list(ground.receive())  # what waited since the start
    codec, deadline = Codec(255, 190), time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for packet in ground.receive():
            for received in codec.decode_datagram(packet):
                if received.source.system == system and isinstance(received.message, Heartbeat):
                    return received.message.armed, Px4(system).mode(received.message)
        time.sleep(0.05)
    raise AssertionError("no heartbeat")


@pytest.mark.row("2")
def test_a_hung_tick_is_silent_within_one_period(world, start_daemon):
    daemon = start_daemon(world.config(2))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    assert all(daemon.listen(PATIENCE, until="WATCHDOG=1") for _ in range(2))
    assert daemon.state()["phase"] == "wait"  # no pilot yet: watched all the same
    daemon.process.send_signal(signal.SIGSTOP)
    daemon.listen(0.15)  # a tick under way
    heard = daemon.count("WATCHDOG=1")
    daemon.listen(1.5 * WATCHDOG)
    assert daemon.count("WATCHDOG=1") == heard
    daemon.process.send_signal(signal.SIGCONT)
    assert daemon.listen(PATIENCE, until="WATCHDOG=1")
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0


def test_without_an_autopilot_the_daemon_waits_and_says_so(world, start_daemon):
    frames = FrameServer("127.0.0.1", 0)
    config = world.config(9, more="board: {}\n")
    text = config.read_text().replace(str(world.frame_port + 9), str(frames.port))
    config.write_text(text.replace(f":{world.companion_port + 9}", ":0"))
    daemon = start_daemon(config)
    assert daemon.listen(PATIENCE, until="EXTEND_TIMEOUT_USEC="), daemon.log()
    assert (
        "STATUS=waiting for heartbeat and telemetry of the autopilot, camera frame, solved plan"
    ) in [line for _, line in daemon.heard]
    assert not daemon.listen(1.0, until="READY=1")
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0
    frames.close()


@pytest.mark.row("12")
def test_a_second_daemon_for_one_vehicle_is_refused(world, start_daemon):
    first = start_daemon(world.config(3))
    assert first.listen(PATIENCE, until="READY=1"), first.log()
    second = start_daemon(world.config(3))
    assert second.process.wait(PATIENCE) == 69
    assert f"flown by another daemon already, process {first.process.pid}" in second.log()
    assert first.process.poll() is None


@pytest.mark.row("12")
def test_another_companion_on_the_link_ends_the_daemon(world, start_daemon):
    daemon = start_daemon(world.config(3))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    other, codec = UdpEndpoint(remote=("127.0.0.1", world.companion_port + 3)), Codec(3, 191)
    other.send(codec.encode([Heartbeat(8, 18, False, 0, 4)]))
    assert daemon.process.wait(PATIENCE) == 69
    assert "another companion system=3 component=191" in daemon.log()
    other.close()


def test_the_cost_of_a_waiting_daemon(world, start_daemon):
    """By processor time and its own ticks, of which each feeds the watchdog.

    Twice what it took on a machine with much else to do: a daemon that polls takes more.
    """
    daemon = start_daemon(world.config(2))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    assert cpu_seconds(daemon.process.pid) <= 3.0
    assert min(cpu_per_tick(daemon, 20) for _ in range(4)) <= 0.03  # of 0.1 s
    status = Path(f"/proc/{daemon.process.pid}/status").read_text()
    assert int(status.split("VmHWM:")[1].split()[0]) <= 150_000  # kB
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0


def cpu_per_tick(daemon, ticks):
    """Return the processor time [s] that the daemon takes for each of its next ticks."""
    before, fed = cpu_seconds(daemon.process.pid), daemon.count("WATCHDOG=1")
    until_fed(daemon, ticks)
    return (cpu_seconds(daemon.process.pid) - before) / (daemon.count("WATCHDOG=1") - fed)


def cpu_seconds(pid):
    """Return user and system time [s] of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.row("38")
@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2])
def test_no_signal_of_a_user_kills_the_daemon(world, start_daemon, number):
    daemon = start_daemon(world.config(2))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    daemon.process.send_signal(number)
    assert daemon.process.wait(PATIENCE) == 0  # a signal that kills gives its negative number
    assert "stopping" in daemon.log()
    assert "stopped" in daemon.log()


WITHOUT_SIGNALS = """
import signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
from companion.__main__ import main
from companion.process import daemon
daemon._ENDING = daemon._ENDING[:2]
sys.exit(main())
"""


@pytest.mark.mutation
def test_row_38_fails_without_the_signals_that_end_a_daemon(world, start_daemon, record_property):
    """SIGTERM and SIGINT alone end it in order then."""
    command = (sys.executable, "-c", WITHOUT_SIGNALS)
    start, said = partial(start_daemon, command=command), ""
    try:
        with pytest.raises(AssertionError) as failed:
            test_no_signal_of_a_user_kills_the_daemon(world, start, signal.SIGHUP)
        said = str(failed.traceback[-1].statement).strip()
        assert "daemon.process.wait(PATIENCE) == 0" in said
    finally:
        record_property("without", ("the signals that end a daemon | 38", f"`{said}`"))


@pytest.mark.row("23")
def test_a_bad_config_ends_with_78_and_its_place(tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("fileversion: 2\nlink: {system_id: 0}\n")
    ended = subprocess.run(
        [sys.executable, "-m", "companion", "run", str(file)], capture_output=True, text=True
    )
    assert ended.returncode == 78
    assert ended.stderr == f"{file}:2:8: link.system_id: must be ≥ 1, ≤ 255, got 0\n"


@pytest.mark.row("20")
def test_a_read_only_log_folder_does_not_stop_the_daemon(world, start_daemon):
    config = world.config(1)
    config.write_text(config.read_text().replace("flight-{time}.mcap", "/proc/nowhere/a.mcap"))
    daemon = start_daemon(config)
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    assert "no flight log: " in daemon.log()
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0


@pytest.mark.row("20")
def test_a_disk_that_fills_ends_the_log_and_nothing_else(world, start_daemon, note):
    daemon = start_daemon(world.config(2))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    until_fed(daemon, 15)
    log = next(daemon.folder.glob("flight-*.mcap"))
    limits = resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE)
    full = (log.stat().st_size, limits[1])
    resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, full)
    until_fed(daemon, 15)  # the ticks go on
    assert "log text=" in daemon.log()
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0
    kept = salvage(log, "/tick")
    assert len(kept) >= 5  # what was flushed before is there
    note("ticks kept", len(kept))


# The line fails in flight, where no stage of the tick stands.
BROKEN_LINE = """
import signal, sys
from companion.__main__ import main
from mavlink_bridge.wire.link import Link
asked = []
signal.signal(signal.SIGRTMIN, lambda *_: asked.append(1))
receive = Link.receive
def broken(self, renew=True):
    if asked:
        raise ZeroDivisionError("of the line")
    return receive(self, renew)
Link.receive = broken
sys.exit(main())
"""


@pytest.mark.row("29")
def test_an_error_outside_the_stages_ends_in_hold_and_in_order(world, start_daemon):
    ground = UdpEndpoint(local=("127.0.0.1", world.ground_port))
    daemon = start_daemon(world.config(3, auto=True), (sys.executable, "-c", BROKEN_LINE))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    daemon.until_phase("fly")
    daemon.process.send_signal(signal.SIGRTMIN)
    assert daemon.listen(PATIENCE, until="STOPPING=1"), daemon.log()
    assert daemon.process.wait(PATIENCE) == 69  # the service manager starts it anew
    assert vehicle_mode(ground, 3) == (True, "hold")
    ground.close()
    failed, stopped = daemon.log().splitlines()[-2:]
    assert re.fullmatch(r'failed what="ZeroDivisionError: of the line \(.*:\d+\)"', failed)
    assert stopped.startswith("stopped deadline_misses=")
    (log,) = daemon.folder.glob("flight-*.mcap")
    assert read_log(log).ticks[-1]["phase"] == "fly"  # closed, and whole to the last tick
