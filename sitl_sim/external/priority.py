"""Real-time priority for what must keep pace with a real autopilot, as a board's units have it.

Needs root or CAP_SYS_NICE. Without it, ticks come late on a busy machine.
"""

from __future__ import annotations

import os
from contextlib import suppress

# Shortest bursts first, as each would have a processor of its own on a drone: a step of the physics
# takes 0.1 ms, a loop of the autopilot 0.3 ms, a picture of the world 5 ms, a tick of a companion
# 20 ms. Two companions ahead of an autopilot hold up its rate loop, and the drone turns over.
PHYSICS, AUTOPILOT, WORLD, BRIDGE, COMPANION = 16, 15, 14, 13, 12


def raise_priority(level: int, pid: int = 0) -> None:
    """Schedule the calling thread, or the first thread of process `pid`, round robin at `level`.

    Threads and processes that it starts from then on inherit this. So raise a process as soon as
    it is started: a thread left behind could hold what the others wait for.
    """
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(level))


def reset_priority() -> None:
    """Schedule the calling thread as any other again."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
