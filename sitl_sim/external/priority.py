"""Real-time priority for what must keep time with a real autopilot, as units give it on a board.

Needs root or CAP_SYS_NICE; without, a machine that is busy with other things lets ticks come late.
"""

from __future__ import annotations

import os
from contextlib import suppress

# Short bursts first, and last those whose naps of 50 µs fill what is left of the machine.
PHYSICS, COMPANION, AUTOPILOT, BRIDGE = 14, 14, 13, 12


def hurry(level: int, pid: int = 0) -> None:
    """Round robin at `level` for the calling thread, or the first thread of process `pid`.

    Threads and processes that it starts from then on are the same. So a process is hurried as
    soon as it is started: a thread of it left behind could hold what the others wait for.
    """
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(level))


def relent() -> None:
    """The calling thread shares the machine again."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
