"""The assignment, compared with scipy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from companion.estimation.assignment import assign


@given(n=st.integers(1, 9), m=st.integers(1, 9), seed=st.integers(0, 10**6), tied=st.booleans())
def test_the_assignment_has_the_least_total_cost(n, m, seed, tied):
    rng = np.random.default_rng(seed)
    cost = rng.integers(0, 4, (n, m)).astype(float) if tied else rng.normal(0.0, 50.0, (n, m))
    pairs = assign(cost)
    assert len(pairs) == min(n, m)
    assert len({r for r, _ in pairs}) == len({c for _, c in pairs}) == len(pairs)
    rows, columns = linear_sum_assignment(cost)
    assert sum(cost[p] for p in pairs) == pytest.approx(cost[rows, columns].sum())
    if not tied:
        assert pairs == list(zip(rows.tolist(), columns.tolist(), strict=True))


def test_an_empty_cost_has_no_assignment():
    assert assign(np.zeros((0, 3))) == []
    assert assign(np.zeros((3, 0))) == []
