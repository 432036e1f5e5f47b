"""Assignment of least total cost: the Hungarian method, exact.

It serves the handful of tracks and detections of one frame. scipy's does the same, and brings 50 MB
of libraries into a daemon that needs nothing else of them. Rows this short are reckoned fastest as
plain numbers.
"""

from __future__ import annotations

import math

from mavlink_bridge.shared.arrays import Vector


def assign(cost: Vector) -> list[tuple[int, int]]:
    """Return the min(n, m) pairs (row, column) of least total cost, by row; finite cost (n,m).

    The method is that of shortest augmenting paths with potentials, O(n² m).
    """
    n, m = cost.shape
    if n > m:
        return sorted((row, column) for column, row in assign(cost.T))
    u, v = [0.0] * (n + 1), [0.0] * (m + 1)  # potentials of rows and columns; index 0 is spare
    row_of = [0] * (m + 1)  # 1-based row that each column is given to; 0: none
    rows = cost.tolist()
    for row in range(1, n + 1):
        row_of[0] = row
        way = _shortest_path(rows, u, v, row_of)
        column = way.pop()
        while way:  # hand the columns on along the path
            before = way.pop()
            row_of[column] = row_of[before]
            column = before
    return sorted((r - 1, c) for c, r in enumerate(row_of[1:]) if r)


def _shortest_path(
    cost: list[list[float]], u: list[float], v: list[float], row_of: list[int]
) -> list[int]:
    """Return the columns on the cheapest path from the spare to a free one; update u and v."""
    m = len(v) - 1
    least, previous = [math.inf] * (m + 1), [0] * (m + 1)
    done, left = [0], list(range(1, m + 1))
    column = 0
    while row := row_of[column]:
        for c in left:
            reach = cost[row - 1][c - 1] - u[row] - v[c]
            if reach < least[c]:
                least[c], previous[c] = reach, column
        column = min(left, key=least.__getitem__)
        delta = least[column]
        for c in done:
            u[row_of[c]] += delta
            v[c] -= delta
        for c in left:
            least[c] -= delta
        left.remove(column)
        done.append(column)
    way = [column]
    while column:
        column = previous[column]
        way.append(column)
    return way[::-1]
