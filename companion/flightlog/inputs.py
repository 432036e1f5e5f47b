"""The exact inputs of a tick as bytes, from which a replay starts.

Layout: a JSON line with the tick's time, the frame's time, the length of each MAVLink datagram and
the columns of the tables of detections; then the datagrams and the tables (float64, little-endian);
then the ranges of a depth image (float16), where there is one, and the points known by parallax
(n,5) (float64). Pixels are not kept: a replay starts
from the detections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any

import numpy as np
import orjson

from companion.perception.frontend import Detections
from companion.types import Detection, Ranges, Trunk
from mavlink_bridge.shared.arrays import Vector


@dataclass(frozen=True)
class RecordedInputs:
    """The inputs of one tick.

    time: s, of the tick. datagrams: since the tick before. frame_time: s, when the newest frame was
    taken; lag: s, by which its stamp is later. drones, trunks, ranges, fixed, flow: its detections,
    where it was new. leave: whether control was to be given back. shown: whether the camera showed
    anything. latest: s, the latest that the vehicle's clock could show, where that was not `time`.
    partly: whether drones were looked for only where they were expected.
    """

    time: float
    datagrams: list[bytes]
    frame_time: float | None = None
    drones: list[Detection] = field(default_factory=list)
    trunks: list[Trunk] = field(default_factory=list)
    ranges: Ranges | None = None
    fixed: Vector = field(default_factory=lambda: np.zeros((0, 7)))
    leave: bool = False
    shown: bool = True
    latest: float | None = None
    flow: Vector | None = None
    lag: float = 0.0
    partly: bool = False


class InputsError(ValueError):
    """Bytes that are no inputs of a tick; the message says why."""


class _Table:
    """Converts dataclasses of one direction (3,) and numbers to rows of float64, and back."""

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.names = [f.name for f in fields(kind) if f.name != "direction"]
        self.numbers = attrgetter(*self.names)

    def encode(self, items: Sequence[Any]) -> bytes:
        if not items:
            return b""
        rows = [[*item.direction.tolist(), *self.numbers(item)] for item in items]
        return np.array(rows, dtype="<f8").tobytes()

    def decode(self, data: bytes, count: int, names: list[str]) -> list[Any]:
        rows = np.frombuffer(data, dtype="<f8").reshape(count, 3 + len(names))
        return [
            self.kind(direction=row[:3].copy(), **dict(zip(names, row[3:].tolist(), strict=True)))
            for row in rows
        ]


_TABLES = {"drones": _Table(Detection), "trunks": _Table(Trunk)}
_COLUMNS = {name: table.names for name, table in _TABLES.items()}


def encode(
    time: float,
    datagrams: Sequence[bytes],
    frame_time: float | None,
    seen: Detections,
    leave: bool = False,
    shown: bool = True,
    latest: float | None = None,
    lag: float = 0.0,
) -> bytes:
    """Return one tick's inputs as bytes; seen: empty where the frame was not new."""
    ranges, fixed = seen.ranges, seen.fixed.rows
    header = {
        "time": time,
        "frame": frame_time,
        "lag": lag,
        "datagrams": [len(d) for d in datagrams],
        "rows": {name: len(getattr(seen, name)) for name in _TABLES},
        "columns": _COLUMNS,
        "leave": leave,
        "ranges": None if ranges is None else ranges.shape,
        "fixed": fixed.shape,
        "shown": shown,
        "partly": seen.partly,
        "latest": latest,
        "flow": None if seen.flow is None else seen.flow.row,
    }
    tables = [table.encode(getattr(seen, name)) for name, table in _TABLES.items()]
    if ranges is not None:
        tables.append(ranges.astype("<f2").tobytes())
    tables.append(fixed.astype("<f8").tobytes())
    return b"".join([orjson.dumps(header), b"\n", *datagrams, *tables])


def decode(data: bytes) -> RecordedInputs:
    """Return the inputs of one tick.

    Raises:
        InputsError: the bytes are no such record.
    """
    line, _, rest = data.partition(b"\n")
    try:
        header = orjson.loads(line)
        datagrams, at = [], 0
        for length in header["datagrams"]:
            datagrams.append(rest[at : at + length])
            at += length
        tables: dict[str, list[Any]] = {}
        for name, table in _TABLES.items():
            count, names = header["rows"][name], header["columns"][name]
            size = 8 * count * (3 + len(names))
            tables[name] = table.decode(rest[at : at + size], count, names)
            at += size
        ranges = None
        if shape := header.get("ranges"):
            size = 2 * shape[0] * shape[1]
            ranges = np.frombuffer(rest[at : at + size], dtype="<f2").reshape(shape)
            at += size
        shape = header.get("fixed", 0)
        shape = [shape, 5] if isinstance(shape, int) else shape  # the number of rows alone
        size = 8 * shape[0] * shape[1]
        fixed = np.frombuffer(rest[at : at + size], dtype="<f8").reshape(shape).copy()
        at += size
        if at != len(rest):
            raise ValueError(f"{len(rest) - at} bytes too many")
        leave, shown = bool(header.get("leave")), bool(header.get("shown", True))
        return RecordedInputs(
            float(header["time"]),
            datagrams,
            header["frame"],
            **tables,
            ranges=ranges,
            fixed=fixed,
            leave=leave,
            shown=shown,
            latest=header.get("latest"),
            flow=np.array(header["flow"], float) if header.get("flow") else None,
            lag=float(header.get("lag", 0.0)),
            partly=bool(header.get("partly", False)),
        )
    except (ValueError, TypeError, KeyError) as error:
        raise InputsError(f"not a tick's inputs: {error}") from error
