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
    os.kill(daemon.process.pid, signal.SIGKILL)
    killed = time.monotonic()
    lost = event_number("commander_failsafe_enter_generic")
    missed = relay.until(lambda m: isinstance(m, Event) and m.event_id == lost, killed, PATIENCE)
    # By the vehicle's own time, in which a machine with other things to do loses nothing.
    failsafe = relay.vehicle_clock(missed) - relay.vehicle_clock(relay.passed_on)
    assert failsafe <= 0.6
    again = start_daemon(config)
    assert relay.setpoints(killed + 0.1) == []
    assert again.listen(PATIENCE, until="READY=1"), again.log()
    ready = time.monotonic() - again.started
    fields = Path(f"/proc/{again.process.pid}/stat").read_text().rpartition(")")[2].split()
    busy = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    assert min(ready, busy) <= 3.0  # however loaded the machine is
    landing = relay.until(lambda m: mode(m) == "land", killed, PATIENCE)
    down = relay.until(lambda m: isinstance(m, Heartbeat) and not m.armed, killed, PATIENCE)
    again.listen(2.0)
    clock = relay.vehicle_clock
    asked = {m.command for t, m in relay.sent if t > killed + 0.1 and isinstance(m, Command)}
    # Neither arming nor a mode, also once it has landed: in spite of `mission.auto`.
    assert asked <= {CommandId.SET_MESSAGE_INTERVAL}
    assert "cut off in control" in again.log()
    modes = [(t, mode(m)) for t, m in relay.told if killed < t < down and mode(m)]
    assert {m for t, m in modes if clock(t) >= clock(missed) + 1.0} <= {"offboard", "land"}
    assert {m for t, m in modes if t >= landing} == {"land"}  # whatever the daemon streams
    note("real process: failsafe", failsafe)
    note("real process: ready again", ready)
    note("real process: LAND", clock(landing) - clock(killed))


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
    if native:
        while not (said := re.search(r"^hangs ([0-9.]+)$", daemon.log(), re.M)):
            assert time.monotonic() - hung < PATIENCE
            daemon.listen(0.05)
        hung = float(said.group(1))
    daemon.listen(0.1)  # what it had told before
    fed = daemon.count("WATCHDOG=1")
    ended = end_as_the_unit_says(daemon)
    assert daemon.count("WATCHDOG=1") == fed
    assert daemon.process.returncode == (-signal.SIGABRT if native else -signal.SIGKILL)
    last = max(relay.setpoints(hung - PATIENCE)) - hung
    assert last <= 0.3
    assert ended <= 1.1
    note(f"last setpoint, {how}", max(last, 0.0))
    note(f"ended, {how}", ended)


def end_as_the_unit_says(daemon):
    """Send SIGABRT after WatchdogSec, and SIGKILL TimeoutAbortSec later to what still stands.

    Return the time [s] from the last feed that the unit leaves the daemon at most.
    """
    watchdog, abort = (
        float(re.search(rf"^{key}=([0-9.]+)", UNIT.read_text(), re.M).group(1))
        for key in ("WatchdogSec", "TimeoutAbortSec")
    )
    daemon.listen(watchdog)
    daemon.process.send_signal(signal.SIGABRT)
    # A process that stands still does not hear SIGABRT; one that hangs in C dies of it.
    stands = Path(f"/proc/{daemon.process.pid}/stat").read_text().rpartition(")")[2].split()[0]
    if stands == "T":
        daemon.listen(abort)
        daemon.process.kill()
    daemon.process.wait(PATIENCE)
    return watchdog + abort
