"""Disturbances of the forest's rows that no fault of a scenario makes.

Each takes the flight, a drone and the kind, and returns {flight time [s]: call()}.
"""

from dataclasses import replace

import numpy as np

from tests.closed_loop.matrix.measures import nan_between, spoil_solves

AT = 9.0  # s, when all faults begin


def killed(f, i, kind):
    def gone():
        f.companions[i].connected = False

    return {AT: gone}


def move_fence(companion, **sides):
    """Give a companion's parts another fence, as no user can in flight."""
    fence = companion._supervision._fence.model_copy(update=sides)
    guidance = companion._guidance
    guidance._settings = replace(guidance._settings, fence=fence)
    for part in (
        companion._supervision,
        companion._surroundings,
        companion._planning._formulation,
    ):
        part._fence = fence


def fence_moves(f, i, kind):
    """Move the fence so that drone i is suddenly outside the side that it flies towards."""

    def cross():
        companion, own = f.companions[i].companion, f.companions[i].outs[-1].own
        axis = int(np.argmax(np.abs(own.v[:2])))
        way = np.sign(own.v[axis])
        f.fences[i] = (axis, way, float(own.p[axis] - 0.1 * way))
        sides = sorted([f.fences[i][2], own.p[axis] - 20.0 * way])
        move_fence(companion, **{("east", "north")[axis]: sides})

    return {AT: cross}


def released(f, i, kind):
    """Let the pipeline leave, as the daemon does on SIGTERM."""

    def leave():
        f.companions[i].before = lambda inputs: replace(inputs, leave=True)

    return {AT: leave}


def bad_solves(which):
    def strike(f, i, kind):
        spoil_solves(f, AT, which, i=i)
        return {}

    return strike


def not_numbers(f, i, kind):
    boot = f._drones[i].boot_ms / 1e3
    f.companions[i].before = nan_between(AT + boot, AT + boot + 3.0)
    spoil_solves(f, AT, range(0, 200, 20), u=lambda u: u * np.nan, i=i)
    return {}
