"""Corner pairs in the flight log: a JSON line with the stamps, then (n,4) float32."""

from __future__ import annotations

import numpy as np
import orjson

from companion.perception.corner_pairs import CornerPairs

TOPIC = "/corners"
CAMERA = "camera"  # name of the metadata record of the lens as configured


def encode(pairs: CornerPairs) -> bytes:
    """Return corner pairs as bytes."""
    header = {"before": pairs.before, "after": pairs.after, "count": len(pairs.pixels)}
    return orjson.dumps(header) + b"\n" + pairs.pixels.astype("<f4").tobytes()


def decode(data: bytes) -> CornerPairs:
    """Return the corner pairs of `encode`.

    Raises:
        ValueError: the bytes are no such record.
    """
    line, _, rest = data.partition(b"\n")
    header = orjson.loads(line)
    pixels = np.frombuffer(rest, "<f4").reshape(header["count"], 4).astype(np.float32)
    return CornerPairs(float(header["before"]), float(header["after"]), pixels)
