"""The recorded ground truth of a flight, in the form that an independent judge reads."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

RATE_HZ = 50
_FIRST_ROOM = 1024  # samples, doubled whenever it is full
_P, _V, _Q = slice(0, 3), slice(3, 6), slice(6, 10)  # columns of a sample
_ARMED, _ESTIMATE, _COLUMNS = 10, slice(11, 14), 14


class Bodies(Protocol):
    """Where vehicles are: p, v (n,3) m and m/s, q (n,4)."""

    @property
    def p(self) -> Vector: ...  # noqa: D102

    @property
    def v(self) -> Vector: ...  # noqa: D102

    @property
    def q(self) -> Vector: ...  # noqa: D102


class Truth:
    """50 Hz samples of every vehicle: t (T,) s; position, velocity (T,N,3); attitude (T,N,4).

    Where the state estimates drift, `estimate` (T,N,3) m is where each autopilot believed to be.

    last_seconds: older samples are dropped, and all memory is taken at once; None: all are kept.
    """

    def __init__(self, names: list[str], last_seconds: float | None = None) -> None:
        self.names = names
        self._wraps = last_seconds is not None
        self._count = 0  # samples so far, dropped ones too
        room = _FIRST_ROOM if last_seconds is None else round(last_seconds * RATE_HZ)
        self._t = np.full(room, np.nan)
        self._rows = np.full((room, len(names), _COLUMNS), np.nan)
        self._estimated = False

    def record(
        self,
        t: float,
        vehicles: Bodies,
        armed: NDArray[np.bool_],
        estimate: Vector | None = None,
    ) -> None:
        """Append the state of all vehicles at t [s]; estimate: (n,3) m, always or never."""
        room = len(self._t)
        if self._count == room and not self._wraps:
            self._t = np.concatenate([self._t, np.full(room, np.nan)])
            self._rows = np.concatenate([self._rows, np.full_like(self._rows, np.nan)])
        at = self._count % len(self._t)
        self._t[at] = t
        row = self._rows[at]
        row[:, _P], row[:, _V], row[:, _Q], row[:, _ARMED] = (
            vehicles.p,
            vehicles.v,
            vehicles.q,
            armed,
        )
        if estimate is not None:
            row[:, _ESTIMATE] = estimate
            self._estimated = True
        self._count += 1

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything that is kept, oldest first, under the names of `truth.npz`."""
        kept = min(self._count, len(self._t))
        order = np.arange(self._count - kept, self._count) % len(self._t)
        rows = self._rows[order]
        arrays: dict[str, NDArray[np.generic]] = {
            "t": self._t[order],
            "position": rows[..., _P].copy(),
            "velocity": rows[..., _V].copy(),
            "attitude": rows[..., _Q].copy(),
            "armed": rows[..., _ARMED] == 1.0,
            "names": np.array(self.names),
        }
        if self._estimated:
            arrays["estimate"] = rows[..., _ESTIMATE].copy()
        return arrays

    def write(self, path: Path) -> str:
        """Write `truth.npz` and return its SHA-256."""
        np.savez_compressed(path, **self.arrays())  # type: ignore[arg-type]
        return hashlib.sha256(path.read_bytes()).hexdigest()
