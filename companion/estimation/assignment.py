"""Assignment of least total cost: the Hungarian method, exact.

It serves the handful of tracks and detections of one frame. scipy's does the same, and brings 50 MB
of libraries into a daemon that needs nothing else of them.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector


def assign(cost: Vector) -> list[tuple[int, int]]:
    """Return the min(n, m) pairs (row, column) of least total cost, by row; finite cost (n,m).

    The method is that of shortest augmenting paths with potentials, O(n² m).
    """
    n, m = cost.shape
    if n > m:
        return sorted((row, column) for column, row in assign(cost.T))
    u, v = np.zeros(n + 1), np.zeros(m + 1)  # potentials of rows and columns; index 0 is spare
    row_of = np.zeros(m + 1, dtype=int)  # 1-based row that each column is given to; 0: none
    for row in range(1, n + 1):
        row_of[0] = row
        way = _shortest_path(cost, u, v, row_of)
        column = way.pop()
        while way:  # hand the columns on along the path
            before = way.pop()
            row_of[column] = row_of[before]
            column = before
    return sorted((int(r) - 1, c) for c, r in enumerate(row_of[1:]) if r)


def _shortest_path(cost: Vector, u: Vector, v: Vector, row_of: Vector) -> list[int]:
    """Return the columns on the cheapest path from the spare to a free one; update u and v."""
    m = len(v) - 1
    least, previous = np.full(m + 1, np.inf), np.zeros(m + 1, dtype=int)
    done = np.zeros(m + 1, dtype=bool)
    column = 0
    while row_of[column]:
        done[column] = True
        reach = cost[row_of[column] - 1] - u[row_of[column]] - v[1:]
        better = ~done[1:] & (reach < least[1:])
        least[1:][better] = reach[better]
        previous[1:][better] = column
        open_columns = np.flatnonzero(~done)
        following = int(open_columns[least[open_columns].argmin()])
        delta = least[following]
        u[row_of[done]] += delta
        v[done] -= delta
        least[~done] -= delta
        column = following
    way = [column]
    while column:
        column = int(previous[column])
        way.append(column)
    return way[::-1]
