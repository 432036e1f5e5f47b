"""The recorded ground truth of a flight, as the judge reads it."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.vehicles.rigid_body import Vehicles


class Truth:
    """50 Hz samples of every vehicle: t (T,) s; position, velocity (T,N,3); attitude (T,N,4)."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        self._t: list[float] = []
        self._rows: list[tuple[Vector, Vector, Vector, NDArray[np.bool_]]] = []

    def record(self, t: float, vehicles: Vehicles, armed: NDArray[np.bool_]) -> None:
        """Append one instant."""
        self._t.append(t)
        self._rows.append(
            (vehicles.p.copy(), vehicles.v.copy(), vehicles.q.copy(), np.array(armed, bool))
        )

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Everything recorded, under the judge's names."""
        p, v, q, armed = (np.stack(column) for column in zip(*self._rows, strict=True))
        return {
            "t": np.array(self._t),
            "position": p,
            "velocity": v,
            "attitude": q,
            "armed": armed,
            "names": np.array(self.names),
        }

    def write(self, path: Path) -> str:
        """Write `truth.npz`; gives its SHA-256."""
        np.savez_compressed(path, **self.arrays())  # type: ignore[arg-type]
        return hashlib.sha256(path.read_bytes()).hexdigest()
