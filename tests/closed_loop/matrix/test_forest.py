"""Every row of the fault matrix in the paper's forest: three drones for 30 s on ten seeds; nine.

In every flight no healthy drone collides, and each drone with a fault reacts as its row requires.
Slow: an hour and a half of one core.
"""

import pytest

from tests.closed_loop.matrix.forest import NINE, ROWS, THREE, flown

SEEDS = 10


def cases():
    """(drones, number of the flight, seed, row), a row once for each flight that shows it."""
    three = [
        (3, n, seed, row)
        for seed in range(SEEDS)
        for n, rows in enumerate(THREE)
        for row in dict.fromkeys(r for r in rows if r)
    ]
    nine = [(9, n, 0, row) for n, rows in enumerate(NINE) for row in dict.fromkeys(rows)]
    return [
        pytest.param(
            *case, marks=pytest.mark.row(case[3]), id=f"{case[0]}-{case[1]}-seed{case[2]}-{case[3]}"
        )
        for case in three + nine
    ]


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("drones", "number", "seed", "row"), cases())
def test_row(drones, number, seed, row, note, record_property):
    record_property("forest", (drones, seed))
    f = flown(drones, number, seed)
    f.check_always(healthy=f.healthy)
    for struck, i, kind in f.strikes:
        if struck == row:
            ROWS[row].check(f, i, kind, note)
