"""Fly for a long time on a signed line that five senders attack, and say what came of it.

    python tests/benchmarks/hostile_hour.py --seconds 3600

10 MB/s in 16,000 packets a second, all on the vehicle's own line: first bytes of frames; random
bytes, cut and mutated copies of the companion's own packets; recorded packets played back both
ways; small packets of other systems; heartbeats and commands forged, and the companion's own
packets reflected. After each 50 s of attack the line is calm for 10 s: ticks are timed by processor
time, and compared with those of the calm between, so that a machine that slows down slows both.
Exit status 1 where a bound is broken.
"""

import argparse
import gc
import math
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from companion.supervision.guard import Reason
from tests.closed_loop.matrix.hostile_checks import listening
from tests.closed_loop.matrix.inprocess import fly

BEGINS = 6.0  # s, when the first attack begins
ATTACKED, CALM = 50.0, 10.0  # s, in turns
SETTLED = 0.5  # s after a turn until ticks count: what has arrived has been read
SENDERS = [
    {"kind": "link_flood", "amount": 3.2e6},
    {"kind": "link_garbage", "amount": 3.3e6},
    {"kind": "link_replay", "amount": 2500.0},
    {"kind": "link_foreign", "amount": 1000.0},
    {"kind": "link_spoof", "amount": 500.0},
    {"kind": "link_forge", "amount": 50.0},
    {"kind": "link_reflect", "amount": 1.0},
]


def flight(attacks):
    """Fly to and fro, attacked so many times; ticks are timed."""
    seconds = 2.0 * BEGINS + attacks * (ATTACKED + CALM)
    faults = [
        fault | {"at": BEGINS + n * (ATTACKED + CALM), "for": ATTACKED}
        for n in range(attacks)
        for fault in SENDERS
    ]

    def watch(f):
        listening(f)
        c = f.companions[0]
        c.stopwatch = time.thread_time
        c.packets, c.bytes, arrived = 0, 0, c.endpoint.receive

        def counted():
            for data in arrived():
                c.packets += 1
                c.bytes += len(data)
                yield data

        c.endpoint.receive = counted

    there_and_back = [[12.0, 0.0, 2.0], [0.0, 0.0, 2.0]]
    return fly(
        faults,
        at={0.0: watch},
        world={},
        drones__signing=True,
        mission__targets=(there_and_back * 450)[: 2 + int(seconds / 8)],
        mission__time_limit=seconds,
    )


def costs(f):
    """Processor time [s] of the ticks in calm, and of those under attack."""
    c = f.companions[0]
    seconds, since = np.array(c.seconds), np.array(c.times) - BEGINS
    since[since >= 0.0] %= ATTACKED + CALM
    calm = ((since < 0.0) & (since > SETTLED - BEGINS)) | (since > ATTACKED + SETTLED)
    return seconds[calm], seconds[(since > SETTLED) & (since < ATTACKED)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0, help="of attack")
    attacks = math.ceil(parser.parse_args().seconds / ATTACKED)
    flight(0)  # what the first flight compiles and loads is no tick's cost
    gc.freeze()
    f = flight(attacks)
    (calm, under), c = costs(f), f.companions[0]
    ours, theirs = c.link.codec.statistics, f._drones[0].companion.codec.statistics
    period = c.config.timing.period
    more = float(np.percentile(under, 99) - np.percentile(calm, 99))
    reasons = {o.verdict.reason.value for o in c.outs if o.verdict and o.time > BEGINS}
    modes = {name for t, name in f.modes[0] if t > BEGINS}
    heard = max(ours.received - theirs.sent, 0) + max(theirs.received - ours.sent, 0)
    print(
        f"{len(calm)} calm ticks, p99 {np.percentile(calm, 99) * 1e3:.1f} ms; "
        f"{len(under)} attacked, p99 {np.percentile(under, 99) * 1e3:.1f} ms, "
        f"most {under.max() * 1e3:.1f} ms"
    )
    attacked = attacks * ATTACKED
    print(f"{c.bytes / attacked / 1e6:.1f} MB/s in {c.packets / attacked:.0f} packets a second")
    print(
        f"refused: {ours.unsigned} unsigned, {ours.replayed} replayed, {ours.bad_bytes} bytes; "
        f"by the vehicle: {theirs.unsigned} unsigned, {theirs.replayed} replayed"
    )
    print(f"heard and not sent: {heard}; own frames heard: {c.echoes}; reasons {sorted(reasons)}; "
          f"other modes: {sorted(modes)}")  # fmt: skip
    bounds = {
        "p99 + 10 % of the period": more <= 0.1 * period,
        "nothing forged or replayed is heard": heard == 0,
        "nothing reflected is heard": c.echoes == 0,
        "no HOLD": not modes & {"HOLD", "LAND"},
        "only plans": reasons == {Reason.PLAN.value},
        "it was attacked": c.bytes > 10e6 * attacked and ours.replayed > 1000 * attacked,
    }
    for what, holds in bounds.items():
        print(f"{'holds ' if holds else 'BROKEN'} {what}")
    return 0 if all(bounds.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
