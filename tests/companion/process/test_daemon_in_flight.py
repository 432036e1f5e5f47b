"""What is done to a daemon's files, signals and memory while its vehicle flies."""

import shutil
import signal
import sys
import time

import pytest

from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.wire.messages import Heartbeat
from tests.companion.deployment import free_ports
from tests.companion.patience import PATIENCE
from tests.companion.relay import Relay

# From the signal on the planner keeps a megabyte of every tick, of the ten that are left.
LEAKS = """
import resource, signal, sys
from pathlib import Path
from companion.__main__ import main
from companion.control.planning import Planning
asked, kept = [], []
def limit(*_):
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + 10_000_000
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    asked.append(1)
signal.signal(signal.SIGRTMIN, limit)
plan = Planning.plan
def leaky(self, *arguments):
    if asked:
        kept.append(bytes(1_000_000))
    return plan(self, *arguments)
Planning.plan = leaky
sys.exit(main())
"""


@pytest.fixture
def flown(world, start_daemon, tmp_path):
    """Start a daemon for vehicle i behind a relay, its log in `tmp_path/logs`; wait till it flies.

    Each test has a vehicle of its own: what a test leaves in the air is taken over by nobody.
    """
    relays, logs = [], tmp_path / "logs"
    logs.mkdir()

    def start(i, command=(sys.executable, "-m", "companion")):
        port = free_ports(1)
        relays.append(Relay(world.companion_port + i, port))
        config = world.config(i, auto=True)
        text = config.read_text().replace(f":{world.companion_port + i}", f":{port}")
        config.write_text(text.replace("flight-{time}.mcap", f"{logs}/flight-{{time}}.mcap"))
        daemon = start_daemon(config, command=command)
        assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
        daemon.until_phase("fly")
        daemon.listen(1.0)
        return daemon, relays[-1], config

    yield start
    for relay in relays:
        relay.close()


def mode(message):
    """Return the mode in a heartbeat; None for other messages."""
    return Px4(1).mode(message) if isinstance(message, Heartbeat) else None


def ended_in_hold(daemon, relay, since):
    """Assert that the daemon gave the vehicle back, and ended by itself, in order."""
    assert daemon.process.wait(PATIENCE) == 0
    held = relay.until(lambda m: mode(m) == "hold", since, PATIENCE)
    assert relay.setpoints(held + 1.0) == []
    assert "stopping streaming=True" in daemon.log()
    assert "stopped" in daemon.log()
    assert "Traceback" not in daemon.log()


@pytest.mark.row("38")
def test_a_hangup_in_flight_ends_the_flight_in_order_and_removed_files_do_not(flown, tmp_path):
    daemon, relay, config = flown(1)
    (log,) = (tmp_path / "logs").glob("*.mcap")
    shutil.rmtree(tmp_path / "logs")
    config.write_text("no: [configuration")
    changed = time.monotonic()
    while len(relay.setpoints(changed)) < 20:
        assert daemon.listen(PATIENCE, until="WATCHDOG=1"), daemon.log()
    assert daemon.state()["phase"] == "fly"
    assert daemon.log().count("was removed") == 1
    assert f"flight log ended: {log} was removed" in daemon.log()
    assert not log.parent.exists()
    daemon.process.send_signal(signal.SIGHUP)
    ended_in_hold(daemon, relay, time.monotonic())


@pytest.mark.row("38")
def test_a_users_signal_in_flight_ends_the_flight_in_order(flown):
    daemon, relay, _ = flown(2)
    daemon.process.send_signal(signal.SIGUSR1)
    ended_in_hold(daemon, relay, time.monotonic())


@pytest.mark.row("38")
def test_a_stage_that_gets_no_memory_ends_in_hold(flown, note):
    """The service's own limit is the kernel's, which kills: that is row 1."""
    daemon, relay, _ = flown(3, (sys.executable, "-c", LEAKS))
    limited = time.monotonic()
    daemon.process.send_signal(signal.SIGRTMIN)
    held = relay.until(lambda m: mode(m) == "hold", limited, PATIENCE)
    daemon.until_phase("passive")
    assert "plan: MemoryError" in daemon.log()
    assert daemon.log().count("stage failed") == 1
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0
    assert relay.setpoints(held + 1.0) == []
    note("held after the limit is set", held - limited)
