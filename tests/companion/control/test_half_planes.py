"""The velocity nearest to a wanted one among half-planes: against a search of all velocities."""

import numpy as np
import pytest

from companion.control.baselines.half_planes import HalfPlanes, nearest_velocity

NONE = HalfPlanes.of([])
EXACT = 5e-6  # m/s


def planes(*rows):
    """Half-planes of rows x, y, least; the normals are made of length 1."""
    each = [(np.array([x, y]) / np.hypot(x, y), least) for x, y, least in rows]
    return HalfPlanes.of(each)


def violation(v, asked):
    return (asked.least - v @ asked.normals.T).max(axis=-1)


def all_velocities(fastest):
    line = np.linspace(-fastest, fastest, 201)
    grid = np.column_stack([a.ravel() for a in np.meshgrid(line, line)])
    return grid[np.linalg.norm(grid, axis=1) <= fastest]


def test_without_half_planes_only_the_speed_limit_counts():
    assert nearest_velocity(np.array([0.6, 0.8]), 1.5, NONE, NONE) == pytest.approx([0.6, 0.8])
    assert nearest_velocity(np.array([3.0, 4.0]), 1.5, NONE, NONE) == pytest.approx([0.9, 1.2])
    assert nearest_velocity(np.zeros(2), 1.5, NONE, NONE) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ([(0, 1, 0.5)], (1.0, 0.5)),  # the foot on a line
        ([(0, 1, 0.5), (-1, 0, -0.4)], (0.4, 0.5)),  # the corner of two lines
        ([(0, 1, 1.2)], (0.9, 1.2)),  # the corner of a line and the speed limit
        ([(1, 0, 0.2), (1, 0, 0.3)], (1.0, 0.0)),  # lines side by side, neither of which binds
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_is_on_the_border_that_is_in_the_way(asked, found, side):
    mirrored = planes(*[(side * x, y, least) for x, y, least in asked])
    v = nearest_velocity(np.array([side, 0.0]), 1.5, NONE, mirrored)
    assert v == pytest.approx([side * found[0], found[1]])


def test_no_velocity_of_a_fine_grid_is_nearer_or_breaks_less():
    rng = np.random.default_rng(3)
    grid, relaxed = all_velocities(1.6), 0
    for _ in range(60):
        asked = planes(*np.column_stack([rng.normal(size=(6, 2)), rng.uniform(-1.5, 0.8, 6)]))
        kept = planes(*np.column_stack([rng.normal(size=(3, 2)), rng.uniform(-1.0, 0.0, 3)]))
        wanted = rng.uniform(-1.5, 1.5, 2)
        v = nearest_velocity(wanted, 1.6, kept, asked)
        assert violation(v, kept) <= EXACT
        assert np.linalg.norm(v) <= 1.6 + EXACT
        may = grid[violation(grid, kept) <= 0.0]
        least = violation(may, asked).min()
        if violation(v, asked) > EXACT:
            relaxed += 1
            assert violation(v, asked) <= least + EXACT
        elif least <= 0.0:
            free = may[violation(may, asked) <= 0.0]
            nearest = np.linalg.norm(free - wanted, axis=1).min()
            assert np.linalg.norm(v - wanted) <= nearest + EXACT
    assert 5 < relaxed < 55  # both kinds were met


def test_where_none_is_free_the_least_is_broken_and_a_wall_still_kept():
    squeezed = planes((1, 0, 1.0), (-1, 0, 0.5))  # v_x at least 1, and at most -0.5
    wanted = np.array([0.0, 1.0])
    v = nearest_velocity(wanted, 1.5, NONE, squeezed)
    assert v == pytest.approx([0.25, 1.0], abs=EXACT)
    assert violation(v, squeezed) == pytest.approx(0.75, abs=EXACT)
    wall = planes((-1, 0, 0.0), (0, -1, -0.3))  # v_x at most 0, v_y at most 0.3
    v = nearest_velocity(wanted, 1.5, wall, squeezed)
    assert v == pytest.approx([0.0, 0.3], abs=EXACT)


def test_lines_that_hardly_cut_lose_no_velocity():
    """Corners far off or ill-defined: what is nearest is found all the same."""
    rng = np.random.default_rng(5)
    wanted = np.array([1.0, 0.3])
    for tilt in 10.0 ** rng.uniform(-15, -3, 200):
        lines = planes((-1.0, tilt, -0.4), (-1.0, -tilt, -0.4 + rng.normal() * tilt))
        v = nearest_velocity(wanted, 1.5, lines, NONE)
        assert violation(v, lines) <= EXACT
        assert v == pytest.approx([0.4, 0.3], abs=5e-3)
