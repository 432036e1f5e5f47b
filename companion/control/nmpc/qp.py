"""The quadratic program of one SQP iteration in PIQP, filled in place.

The variables are u_0, then for k = 1…N: x_k, a slack for each margin, u_k (k < N); all but the
slacks are steps from the iterate. That order makes the matrices block-banded, which PIQP's
multistage backend factorises in time linear in N. One slack for all would make room for a second
intrusion that is no deeper than the first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.layout import (
    LOCAL,
    LOCAL_BEFORE,
    LOCAL_NEXT,
    LOCAL_U,
    LOCAL_X,
    Indices,
    Piece,
    StageLayout,
)
from companion.model import NU, NX
from mavlink_bridge.shared.arrays import Vector

# Curvature for directions without cost; on steps, it moves no solution.
DAMPING = 1e-6
# The bounds on the input are tightened by this: the solvers' tolerance.
TIGHT = 2e-5

# PIQP's iterations for one of the kernel's: the limit of work is to end both after as many steps.
_KERNELS = 2

# Rows, columns and sources of some entries of a matrix.
Entries = tuple[Indices, Indices, Indices]


@dataclass(frozen=True)
class Layout:
    """The place of each variable in the program."""

    size: int
    u: Indices  # (N, 4)
    x: Indices  # (N, 10), x_1…x_N
    slack: Indices  # (N, rows) of the margins at 1…N

    def local(self, stage: int) -> Indices:
        """Return the places of a stage's local variables; -1 for x_0 and u_{-1}."""
        places = np.full(LOCAL, -1)
        places[LOCAL_U] = self.u[stage]
        places[LOCAL_NEXT] = self.x[stage]
        if stage > 0:
            places[LOCAL_X] = self.x[stage - 1]
            places[LOCAL_BEFORE] = self.u[stage - 1]
        return places


def layout(N: int, rows: int) -> Layout:
    """Return the order of the variables, with `rows` margins a stage."""
    u, x, slack = np.zeros((N, NU), int), np.zeros((N, NX), int), np.zeros((N, rows), int)
    u[0], place = np.arange(NU), NU
    for k in range(N):
        x[k] = place + np.arange(NX)
        slack[k] = place + NX + np.arange(rows)
        place += NX + rows
        if k < N - 1:
            u[k + 1] = place + np.arange(NU)
            place += NU
    return Layout(place, u, x, slack)


def input_bounds(config: NmpcConfig) -> tuple[Vector, Vector]:
    """Return the least and largest input (4,) of (35), (36), tightened: no plan exceeds these."""
    rates = [config.omega_max - TIGHT] * 3
    return np.array([config.c_min + TIGHT, *[-r for r in rates]]), np.array(
        [config.c_max - TIGHT, *rates]
    )


def change_bounds(config: NmpcConfig) -> Vector:
    """Return the largest change (4,) of the input per step, (33), (34), tightened."""
    return np.array([config.delta_c_max, *[config.delta_omega_max] * 3]) - TIGHT


class Gather:
    """Sums entries of a source array into the places of a target, at most two for each."""

    def __init__(self, places: Indices, sources: Indices) -> None:
        order = np.argsort(places, kind="stable")
        places, sources = places[order], sources[order]
        first = np.ones(len(places), dtype=bool)
        first[1:] = places[1:] != places[:-1]
        self.places = places[first]
        self.sources = sources[first]
        self.more_places, self.more_sources = places[~first], sources[~first]
        if len(set(self.more_places.tolist())) != len(self.more_places):
            raise AssertionError("more than two sources for one place")

    def fill(self, source: Vector, target: Vector) -> None:
        """Overwrite the places of `target`."""
        target[self.places] = source[self.sources]
        target[self.more_places] += source[self.more_sources]


class Matrix:
    """A CSC matrix of fixed structure, refilled from a source array."""

    def __init__(self, shape: tuple[int, int], entries: list[Entries]) -> None:
        from scipy import sparse

        rows, columns, sources = (np.concatenate(part) for part in zip(*entries, strict=True))
        keys = columns * shape[0] + rows
        unique, places = np.unique(keys, return_inverse=True)
        pointers = np.searchsorted(unique, np.arange(shape[1] + 1) * shape[0])
        self.csc = sparse.csc_matrix(
            (np.zeros(len(unique)), unique % shape[0], pointers), shape=shape
        )
        self.gather = Gather(places, sources)

    def fill(self, source: Vector) -> None:
        """Overwrite the numbers."""
        self.gather.fill(source, self.csc.data)


class Program:
    """The quadratic program: its structure is built once, its numbers are filled in place."""

    def __init__(self, config: NmpcConfig, stage: StageLayout) -> None:
        import piqp  # with scipy 150 MB, for machines without a C compiler alone

        self.config = config
        N = config.N
        self.where = layout(N, len(stage.margin.rows))
        self.count = stage.size
        constants = np.array([1.0, -1.0, DAMPING, config.penalty_quadratic])
        self.source = np.concatenate([np.zeros(N * stage.size), constants])
        first = N * stage.size
        self._one, self._minus, self._damping, self._quadratic = range(first, first + 4)
        self._hessian(stage)
        self._equalities(stage)
        self._inequalities(stage)
        self._bounds()
        self.solver, self._solved = piqp.SparseSolver(), piqp.PIQP_SOLVED
        settings = self.solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.max_iter = 60
        # The numbers are of order one already: scaling costs time and iterations.
        settings.preconditioner_iter = 0
        settings.eps_abs = settings.eps_duality_gap_abs = 1e-5
        settings.eps_rel = settings.eps_duality_gap_rel = 1e-6
        self._ready = False
        self.iterations = 0

    def _sources(self, stage: int, piece: Piece, keep: NDArray[np.bool_]) -> Indices:
        """Return the places in `source` of a piece's entries that are kept."""
        return stage * self.count + piece.offset + np.flatnonzero(keep)

    def _constant(self, rows: Indices, columns: Indices, which: int) -> Entries:
        """Return entries that all have the same source, one of the constants."""
        return rows, columns, np.full(len(rows), which)

    def _hessian(self, stage: StageLayout) -> None:
        """Build the cost: P, the upper triangle, and c."""
        entries: list[Entries] = []
        gradient_places, gradient_sources = [], []
        for i in range(self.config.N):
            places = self.where.local(i)
            rows, columns = places[stage.hessian.rows], places[stage.hessian.columns]
            keep = (rows >= 0) & (columns >= 0)
            low, high = np.minimum(rows, columns)[keep], np.maximum(rows, columns)[keep]
            entries.append((low, high, self._sources(i, stage.hessian, keep)))
            slope = places[stage.gradient.rows]
            gradient_places.append(slope[slope >= 0])
            gradient_sources.append(self._sources(i, stage.gradient, slope >= 0))
        slack = self.where.slack.ravel()
        entries.append(self._constant(slack, slack, self._quadratic))
        damped = self.where.x.ravel()
        occupied = {
            (r, c) for e in entries for r, c in zip(e[0].tolist(), e[1].tolist(), strict=True)
        }
        bare = np.array([d for d in damped.tolist() if (d, d) not in occupied], dtype=int)
        entries.append(self._constant(bare, bare, self._damping))
        self.P = Matrix((self.where.size, self.where.size), entries)
        self.c = np.zeros(self.where.size)
        self.c[slack] = self.config.penalty
        self._gradient = Gather(np.concatenate(gradient_places), np.concatenate(gradient_sources))

    def _equalities(self, stage: StageLayout) -> None:
        """Build the dynamics (31), A x = b."""
        entries: list[Entries] = []
        local = np.r_[np.arange(NX), np.arange(NX + NU, NX + 2 * NU)]
        gaps = []
        for i in range(self.config.N):
            columns = self.where.local(i)[local][stage.dynamics.columns]
            rows = i * NX + stage.dynamics.rows
            keep = columns >= 0
            entries.append((rows[keep], columns[keep], self._sources(i, stage.dynamics, keep)))
            entries.append(self._constant(i * NX + np.arange(NX), self.where.x[i], self._minus))
            gaps.append(self._sources(i, stage.gap, np.ones(NX, dtype=bool)))
        self.A = Matrix((NX * self.config.N, self.where.size), entries)
        self.b = np.zeros(NX * self.config.N)
        self._gaps = np.concatenate(gaps)

    def _inequalities(self, stage: StageLayout) -> None:
        """Build h_l <= G x <= h_u, stage by stage: change of input (33), (34), then margins."""
        entries: list[Entries] = []
        agents, row = self.config.neighbours, 0
        margin_rows, margins, change_rows = [], [], []
        count = len(stage.margin.rows)
        for i in range(self.config.N):
            if i > 0:
                rows = row + np.arange(NU)
                entries.append(self._constant(rows, self.where.u[i], self._one))
                entries.append(self._constant(rows, self.where.u[i - 1], self._minus))
                change_rows.append(rows)
                row += NU
            used = np.ones(count, dtype=bool)
            used[:agents] = i < self.config.M_constraint
            place = np.cumsum(used) - 1 + row
            keep = used[stage.slope.rows]
            entries.append(
                (
                    place[stage.slope.rows][keep],
                    self.where.x[i][:3][stage.slope.columns][keep],
                    self._sources(i, stage.slope, keep),
                )
            )
            entries.append(self._constant(place[used], self.where.slack[i][used], self._one))
            margin_rows.append(place[used])
            margins.append(self._sources(i, stage.margin, used))
            row += int(used.sum())
        self.G = Matrix((row, self.where.size), entries)
        self.h_l, self.h_u = np.full(row, -np.inf), np.full(row, np.inf)
        self._change_rows = np.array(change_rows, dtype=int).reshape(-1, NU)
        self._margin_rows, self._margins = np.concatenate(margin_rows), np.concatenate(margins)

    def _bounds(self) -> None:
        """Build x_l <= x <= x_u: the input, (35), (36), and the slacks."""
        self.u_min, self.u_max = input_bounds(self.config)
        self.change = change_bounds(self.config)
        self.x_l = np.full(self.where.size, -np.inf)
        self.x_u = np.full(self.where.size, np.inf)
        self.x_l[self.where.slack] = 0.0

    def solve(
        self, u: Vector, u_last: Vector, *, again: bool = False
    ) -> tuple[Vector, Vector] | None:
        """Return the steps (dx of x_1…x_N, du) from the linearisation in `source`, or None.

        u (N,4): the iterate. u_last (4,): the input before, within its bounds. again: the iterate
        is the last one and its step; PIQP makes no use of it. None: PIQP found no solution.
        """
        source = self.source
        for matrix in (self.P, self.A, self.G):
            matrix.fill(source)
        self._gradient.fill(source, self.c)
        np.negative(source[self._gaps], out=self.b)
        self.h_l[self._margin_rows] = -source[self._margins]
        changes = u[1:] - u[:-1]
        self.h_l[self._change_rows] = -self.change - changes
        self.h_u[self._change_rows] = self.change - changes
        low, high = self.u_min - u, self.u_max - u
        low[0] = np.maximum(low[0], u_last - self.change - u[0])
        high[0] = np.minimum(high[0], u_last + self.change - u[0])
        self.x_l[self.where.u], self.x_u[self.where.u] = low, high
        data = (self.P.csc, self.c, self.A.csc, self.b, self.G.csc)
        sides = (self.h_l, self.h_u, self.x_l, self.x_u)
        if self._ready:
            self.solver.update(*data, *sides)
        else:
            self.solver.setup(*data, *sides)
            self._ready = True
        status = self.solver.solve()
        self.iterations = self.solver.result.info.iter // _KERNELS
        if status != self._solved:
            return None
        step = self.solver.result.x
        return step[self.where.x], step[self.where.u]
