"""Boxes of labelled drone videos: MATLAB `groundTruth` objects, read without MATLAB.

The public set `DroneDetectionThesis/Drone-detection-dataset` (CC0) saves them as MAT5. SciPy reads
only the raw workspace of such an object; this module walks its elements. The format is in "MAT-File
Format", The MathWorks, chapter "Level 5 MAT-File".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from companion.bench.labels import LabelError
from mavlink_bridge.shared.arrays import Vector

Boxes = dict[str, Vector]  # class → (n,4) x, y, width, height [px], from 0
_MATRIX, _OPAQUE, _CELL, _STRUCT, _OBJECT, _DOUBLE = 14, 17, 1, 2, 3, 6
_TYPES = {1: "b", 2: "B", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 9: "<f8"}
_TYPES |= {12: "<i8", 13: "<u8", 16: "B", 17: "<u2", 18: "<u4"}


def read_boxes(file: Path) -> list[Boxes]:
    """Return the boxes of each frame of a video's label file.

    Raises:
        LabelError: a file that is missing or holds no such labels.
    """
    try:
        data = scipy.io.loadmat(file)["__function_workspace__"].tobytes()
        nodes = [_matrix(data, at, n) for t, at, n in _elements(data, 8, len(data)) if t == _MATRIX]
    except (OSError, KeyError, ValueError, IndexError, NotImplementedError, struct.error) as error:
        raise LabelError(f"{file}: not a MATLAB groundTruth file: {error!r}") from error
    for node in nodes:
        if found := _search(node):
            return found
    raise LabelError(f"{file}: holds no table of boxes per frame")


def _elements(data: bytes, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield type, offset and length of the data of each element."""
    while start + 8 <= end:
        kind, size = struct.unpack_from("<II", data, start)
        if kind >> 16:  # a small element: size and type share four bytes
            size, kind = kind >> 16, kind & 0xFFFF
            at, following = start + 4, start + 8
        else:
            at = start + 8
            following = at + (size if kind == 15 else (size + 7) // 8 * 8)
        if at + size > end or kind == 0:
            return
        yield kind, at, size
        start = following


def _matrix(data: bytes, start: int, size: int) -> tuple[int, list[int], Any] | None:
    """Return class, dimensions and value of a matrix element, nested ones included."""
    parts = list(_elements(data, start, start + size))
    if not parts:
        return None
    kind = struct.unpack_from("<I", data, parts[0][1])[0] & 0xFF
    if kind == _OPAQUE:
        return kind, [], [_matrix(data, at, n) for t, at, n in parts if t == _MATRIX]
    dims = np.frombuffer(data, "<i4", parts[1][2] // 4, parts[1][1]).tolist()
    rest = parts[3:]
    if kind == _CELL:
        return kind, dims, [_matrix(data, at, n) for t, at, n in rest if t == _MATRIX]
    if kind in (_STRUCT, _OBJECT):
        rest = rest[1:] if kind == _OBJECT else rest
        names = data[rest[1][1] : rest[1][1] + rest[1][2]]
        fields = [_matrix(data, at, n) for t, at, n in rest[2:] if t == _MATRIX]
        return kind, dims, (names, fields)
    if not rest:
        return kind, dims, np.zeros(0)
    of, at, n = rest[0]
    dtype = np.dtype(_TYPES.get(of, "B"))
    values = np.frombuffer(data, dtype, n // dtype.itemsize, at)
    whole = int(np.prod(dims)) == len(values)
    return kind, dims, values.reshape(dims, order="F") if whole else values


def _search(node: tuple[int, list[int], Any] | None) -> list[Boxes]:
    """Return the frames of the first table of boxes in or below a node; empty where there is none.

    The table is a structure array with a field Time and one field for each class.
    """
    if node is None or node[0] not in (_CELL, _OPAQUE, _STRUCT, _OBJECT):
        return []
    kind, dims, value = node
    inner = value
    if kind in (_STRUCT, _OBJECT):
        names, inner = value
        keys = names.replace(b"\0", b" ").decode("latin-1").split()
        frames = dims[0] * dims[1] if len(dims) == 2 else 0
        if keys[:1] == ["Time"] and frames and len(inner) == len(keys) * frames:
            rows = [inner[i * len(keys) : (i + 1) * len(keys)] for i in range(frames)]
            return [_frame(keys[1:], row[1:]) for row in rows]
    return next((found for each in inner if (found := _search(each))), [])


def _frame(classes: list[str], cells: list[tuple[int, list[int], Any] | None]) -> Boxes:
    """Return the boxes of one frame; MATLAB counts pixels from 1."""
    return {
        name: np.array(cell[2], float).reshape(-1, 4) - [1, 1, 0, 0]
        for name, cell in zip(classes, cells, strict=True)
        if cell and cell[0] == _DOUBLE and np.size(cell[2]) and cell[1][1:] == [4]
    }
