"""A daemon that dies or hangs in flight, as the vehicle sees it on the link."""

import os
import re
import signal
import sys
import time
from pathlib import Path

import pytest

from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.autopilots.px4_events import event_number
from mavlink_bridge.wire.messages import Command, CommandId, Event, Heartbeat
from tests.companion.deployment import free_ports
from tests.companion.patience import PATIENCE
from tests.companion.relay import Relay

PARAMETERS = {"COM_OF_LOSS_T": 0.5}  # of the emulated vehicles
UNIT = Path(__file__).parents[3] / "systemd" / "companion@.service"
# A tick that calls into C and does not come back; the call keeps the interpreter's lock.
HANGS = """
import ctypes, signal, sys, time
from companion.__main__ import main
from companion.control.planning import Planning
asked = []
signal.signal(signal.SIGRTMIN, lambda *_: asked.append(1))
plan = Planning.plan
def stuck(self, *arguments):
    if asked:
        print(f"hangs {time.monotonic():.6f}", file=sys.stderr, flush=True)
        ctypes.PyDLL(None).sleep(10)
    return plan(self, *arguments)
Planning.plan = stuck
sys.exit(main())
"""


@pytest.fixture
def flown(world, start_daemon):
    """Start a daemon for vehicle i behind a relay, and wait until it flies."""
    relays = []

    def start(i, command=(sys.executable, "-m", "companion")):
        port = free_ports(1)
        relays.append(Relay(world.companion_port + i, port))
        config = world.config(i, auto=True)
        config.write_text(config.read_text().replace(f":{world.companion_port + i}", f":{port}"))
        daemon = start_daemon(config, command=command)
        assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
        daemon.until_phase("fly")
        daemon.listen(1.0)
        return daemon, relays[-1], config

    yield start
    for relay in relays:
        relay.close()


@pytest.mark.row("1")
def test_the_vehicle_misses_a_killed_daemon_and_a_new_one_is_passive(flown, start_daemon, note):
    daemon, relay, config = flown(1)
    killed = time.monotonic()
    os.kill(daemon.process.pid, signal.SIGKILL)
    lost = event_number("commander_failsafe_enter_generic")
    missed = relay.until(lambda m: isinstance(m, Event) and m.event_id == lost, killed, 5.0)
    assert missed - killed <= 0.6
    again = start_daemon(config)
    assert relay.setpoints(killed + 0.1) == []
    assert again.listen(PATIENCE, until="READY=1"), again.log()
    ready = time.monotonic() - again.started
    fields = Path(f"/proc/{again.process.pid}/stat").read_text().rpartition(")")[2].split()
    busy = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    assert min(ready, busy) <= 3.0  # however loaded the machine is
    landing = relay.until(lambda m: mode(m) == "land", killed, 20.0)
    asked = {m.command for t, m in relay.sent if t > killed + 0.1 and isinstance(m, Command)}
    assert asked <= {CommandId.SET_MESSAGE_INTERVAL}  # neither arming nor a mode
    after = {mode(m) for t, m in relay.told if t >= missed + 1.0} - {None}
    assert after <= {"offboard", "land"}  # back in offboard once it is disarmed, as PX4 is
    disarmed = [t for t, m in relay.told if isinstance(m, Heartbeat) and not m.armed and t > missed]
    flown = {mode(m) for t, m in relay.told if landing <= t < min([*disarmed, 1e9])} - {None}
    assert flown == {"land"}  # whatever the daemon streams
    note("real process: failsafe", missed - killed)
    note("real process: ready again", ready)
    note("real process: LAND", landing - killed)


def mode(message):
    """Return the mode in a heartbeat; None for other messages."""
    return Px4(1).mode(message) if isinstance(message, Heartbeat) else None


@pytest.mark.row("2")
@pytest.mark.parametrize("how", ["native call", "SIGSTOP"])
def test_a_hung_tick_is_silent_and_ended(flown, note, how):
    native = how == "native call"
    command = (sys.executable, "-c", HANGS) if native else (sys.executable, "-m", "companion")
    daemon, relay, _ = flown(2 + native, command)
    daemon.process.send_signal(signal.SIGRTMIN if native else signal.SIGSTOP)
    hung = time.monotonic()
    end_as_the_unit_says(daemon)
    ended = time.monotonic()
    if native:
        hung = float(re.search(r"hangs ([0-9.]+)", daemon.log()).group(1))
    last = max(relay.setpoints(hung - 1.0)) - hung
    assert last <= 0.3
    assert ended - hung <= 1.1
    note(f"last setpoint, {how}", max(last, 0.0))
    note(f"ended, {how}", ended - hung)


def end_as_the_unit_says(daemon):
    """Send SIGABRT WatchdogSec after the last feed, and SIGKILL TimeoutAbortSec later."""
    patience, abort = (
        float(re.search(rf"^{key}=([0-9.]+)", UNIT.read_text(), re.M).group(1))
        for key in ("WatchdogSec", "TimeoutAbortSec")
    )
    while True:
        fed = daemon.started + max(t for t, line in daemon.heard if line.startswith("WATCHDOG"))
        left = fed + patience - time.monotonic()
        if left <= 0.0:
            break
        daemon.listen(left, until="WATCHDOG")
    daemon.process.send_signal(signal.SIGABRT)
    if daemon.process.poll() is None:
        daemon.listen(abort)  # returns when it has ended
    if daemon.process.poll() is None:
        daemon.process.kill()
    daemon.process.wait(PATIENCE)
