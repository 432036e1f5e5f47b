"""Points as the boxes that hold them: cells of a grid, joined where they fill a block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mavlink_bridge.shared.arrays import Vector

Block = tuple[tuple[float, ...], tuple[float, ...]]
"""Least and greatest corner [m]."""
_Runs = dict[tuple[int, ...], list[tuple[int, int]]]


def boxes_of(
    points: Vector, cell: float, least: int, most_cells: int, low: float
) -> list[Block] | None:
    """Return the blocks that hold points (n,3) m; None where the grid would be too large.

    cell: edge of a cell [m]; least: points of cells that hang together, fewer are noise; low:
    height [m] of the lower edge of the points: a cell there reaches the ground.
    """
    if not len(points):
        return []
    at = np.floor(points / cell + 1e-9).astype(int)
    corner = at.min(axis=0)
    at -= corner
    shape = at.max(axis=0) + 1
    if shape.prod() > most_cells:
        return None
    full = np.zeros(shape, bool)
    full[tuple(at.T)] = True
    labels, number = ndimage.label(full, np.ones((3, 3, 3)))
    enough = np.bincount(labels[tuple(at.T)], minlength=number + 1) >= least
    full = enough[labels] & full
    boxes = []
    edge = int(np.floor(low / cell + 1e-9))
    for first, last in blocks(full):
        lowest = (np.array(first) + corner) * cell
        highest = (np.array(last) + corner) * cell
        if first[2] + corner[2] <= edge:
            lowest[2] = 0.0
        boxes.append((_rounded(lowest), _rounded(highest)))
    return boxes


def _rounded(corner: Vector) -> tuple[float, ...]:
    return tuple(round(float(v), 3) for v in corner)


def blocks(full: NDArray[np.bool_]) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return blocks (first, last + 1 of each index) that hold all cells of a grid and no other.

    Runs along z are joined where they are alike along y, and these along x.
    """
    padded = np.pad(full, ((0, 0), (0, 0), (1, 1))).astype(np.int8)
    step = np.diff(padded, axis=2)
    begin, end = np.argwhere(step == 1), np.argwhere(step == -1)
    runs: _Runs = {}  # z0, z1, x → runs of y
    for (x, y, z0), z1 in zip(begin.tolist(), end[:, 2].tolist(), strict=True):
        runs.setdefault((z0, z1, x), []).append((y, y + 1))
    plates: _Runs = {}  # z0, z1, y0, y1 → runs of x
    for z0, z1, x in sorted(runs):
        for y0, y1 in _joined(runs[z0, z1, x]):
            plates.setdefault((z0, z1, y0, y1), []).append((x, x + 1))
    return [
        ((x0, y0, z0), (x1, y1, z1))
        for (z0, z1, y0, y1), spans in plates.items()
        for x0, x1 in _joined(spans)
    ]


def _joined(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return sorted spans, those that touch as one."""
    joined: list[tuple[int, int]] = []
    for first, last in spans:
        if joined and joined[-1][1] == first:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined
