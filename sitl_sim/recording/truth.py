"""The recorded ground truth of a flight, in the form that an independent judge reads."""

from __future__ import annotations

import hashlib
from collections import deque
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

RATE_HZ = 50


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

    last_seconds: older samples are dropped; None: all are kept.
    """

    def __init__(self, names: list[str], last_seconds: float | None = None) -> None:
        self.names = names
        most = None if last_seconds is None else round(last_seconds * RATE_HZ)
        self._t: deque[float] = deque(maxlen=most)
        self._estimates: deque[Vector] = deque(maxlen=most)
        self._rows: deque[tuple[Vector, Vector, Vector, NDArray[np.bool_]]] = deque(maxlen=most)

    def record(
        self,
        t: float,
        vehicles: Bodies,
        armed: NDArray[np.bool_],
        estimate: Vector | None = None,
    ) -> None:
        """Append the state of all vehicles at t [s]; estimate: (n,3) m, always or never."""
        self._t.append(t)
        if estimate is not None:
            self._estimates.append(estimate.copy())
        self._rows.append(
            (vehicles.p.copy(), vehicles.v.copy(), vehicles.q.copy(), np.array(armed, bool))
        )

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything recorded, under the names of `truth.npz`."""
        p, v, q, armed = (np.stack(column) for column in zip(*self._rows, strict=True))
        arrays = {
            "t": np.array(self._t),
            "position": p,
            "velocity": v,
            "attitude": q,
            "armed": armed,
            "names": np.array(self.names),
        }
        if self._estimates:
            arrays["estimate"] = np.stack(self._estimates)
        return arrays

    def write(self, path: Path) -> str:
        """Write `truth.npz` and return its SHA-256."""
        np.savez_compressed(path, **self.arrays())  # type: ignore[arg-type]
        return hashlib.sha256(path.read_bytes()).hexdigest()
