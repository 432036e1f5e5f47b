"""Real-time priority for what must keep time with a real autopilot, as units give it on a board.

Needs root or CAP_SYS_NICE; without, a machine that is busy with other things lets ticks come late.
"""

from __future__ import annotations

import os
from contextlib import suppress

PHYSICS, AUTOPILOT, BRIDGE, COMPANION = 14, 13, 12, 11


def hurry(level: int, pid: int = 0) -> None:
    """Round robin at `level` for the calling thread, or the first thread of process `pid`.

    Threads and processes that it starts from then on are the same.
    """
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(level))


def relax(pid: int) -> None:
    """The first thread of process `pid` shares the machine again, ahead of what has no hurry."""
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, pid, -20)
