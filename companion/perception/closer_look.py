"""A closer look: what a search takes for drones, judged one by one by a second network.

The search (`eyes`) makes the picture eight times smaller, and gives few channels to each place. A
closer look gives more of them to the few places that could be drones: each is cut out at the
picture's own resolution, so that the drone has always the same size in the cut-out, and once more
twice as wide, so that a hull is not taken for a whole drone farther off. It gets a probability of
its own, a better place and a better size. As in R-CNN (Girshick et al., 2014).
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception import heat_map
from companion.perception.eyes import FEATURES, Look
from companion.perception.heat_map import STRIDE, Cells, Peaks, scale_of
from companion.perception.networks import SenselessOutput
from companion.perception.onnx_runtime import opened
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector

PACKAGED = Path(__file__).with_name("models") / "closer.onnx"
SIDE = 40  # px of a cut-out
RADII = 4.0  # width of a cut-out over the drone's radius
WIDER = (1.0, 2.0)  # widths of the cut-outs of one place over that
PLANES = 3 * len(WIDER)
LEAST = 28.0  # px of the picture that a cut-out shows at least
CHANNELS = 5  # logit, offset u and v [cut-out widths], log of size over expected, log of its scale
# Numbers that tell what the search says of a place: features of 3×3 cells, output for the middle.
AROUND = 9 * FEATURES + heat_map.CHANNELS
_SURE = 1e-4  # heat is taken to be this far from 0 and 1
_LEVELS = 5  # the picture, and halves of it
_INPUTS = {"cut_outs": ["n", PLANES, SIDE, SIDE], "around": ["n", AROUND]}
_OUTPUTS = {"drones": ["n", CHANNELS]}
_FAR_OFF = 1.5  # most that the logarithm of a size is corrected by
_LOGIT, _DU, _DV, _LOG_RATIO, _LOG_SCALE = range(CHANNELS)


class CloserLook:
    """Runs the network on places of a picture.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, model: Path = PACKAGED) -> None:
        self._session = opened(model, _INPUTS, _OUTPUTS, "a closer look")

    def judge(
        self, image: Image, look: Look, peaks: Peaks, searched: Vector | None = None
    ) -> Peaks:
        """Return the places in image (H,W,3) uint8 BGR with probabilities, places and sizes anew.

        They are the likeliest first. image: of the size that the search takes. look: what it said,
        of this picture, or of an earlier one. searched: (n,2) px, where the same drones were in
        that one.

        Raises:
            SenselessOutput: an output that is not finite.
        """
        if not len(peaks):
            return peaks
        cuts = cut_outs(image, peaks.places, peaks.sizes)
        planes = np.ascontiguousarray(cuts.transpose(0, 3, 1, 2), np.float32)
        given = {
            "cut_outs": planes,
            "around": around(look, peaks.places if searched is None else searched),
        }
        (raw,) = self._session.run(list(_OUTPUTS), given)
        if not np.isfinite(raw).all():
            raise SenselessOutput("the closer look gives NaN or infinite numbers")
        order = np.argsort(-raw[:, _LOGIT], kind="stable")
        out, width = raw[order].astype(float), widths(peaks.sizes[order])
        return Peaks(
            peaks.places[order] + width[:, None] * out[:, [_DU, _DV]],
            width / RADII * np.exp(np.clip(out[:, _LOG_RATIO], -_FAR_OFF, _FAR_OFF)),
            scale_of(out[:, _LOG_SCALE]),
            1.0 / (1.0 + np.exp(-out[:, _LOGIT])),
        )


def around(look: Look, places: Vector) -> Cells:
    """Return what the search says of places (n,2) u, v [px]: (n,AROUND)."""
    height, width = look.features.shape[1:]
    column, row = np.round((places.T + 0.5) / STRIDE - 0.5).astype(int)
    column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
    padded = np.pad(look.features, ((0, 0), (1, 1), (1, 1)))
    cells = [padded[:, row + i, column + j] for i in range(3) for j in range(3)]
    heat = np.clip(look.drones[0, row, column], _SURE, 1.0 - _SURE)
    said = [np.log(heat / (1.0 - heat))[None], look.drones[1:, row, column]]
    return np.ascontiguousarray(np.concatenate([*cells, *said]).T, np.float32)


def widths(sizes: Vector) -> Vector:
    """Return the widths (n,) [px] of cut-outs for drones of radii (n,) [px]."""
    return np.maximum(RADII * sizes, LEAST)


def cut_outs(image: Image, places: Vector, sizes: Vector) -> NDArray[np.uint8]:
    """Return cut-outs (n,SIDE,SIDE,PLANES) of image (H,W,3) round places (n,2) u, v [px].

    sizes: (n,) px, the drones' radii there. BGR of one for each of WIDER. The picture's edge goes
    on outside it.
    """
    levels = [image]
    out = np.empty((len(places), len(WIDER), SIDE, SIDE, 3), np.uint8)
    all_widths = widths(sizes)[:, None] * WIDER
    for n, k in np.ndindex(all_widths.shape):
        u, v = places[n]
        scale = all_widths[n, k] / SIDE
        level = int(np.clip(np.log2(scale), 0, _LEVELS - 1))
        while len(levels) <= level:
            height, wide = levels[-1].shape[:2]
            half = cv2.resize(levels[-1], (wide // 2, height // 2), interpolation=cv2.INTER_AREA)
            levels.append(np.asarray(half, np.uint8))
        reduced = 2.0**level
        step = scale / reduced
        middle = step * (SIDE - 1) / 2
        move = np.array(
            [
                [step, 0.0, (u + 0.5) / reduced - 0.5 - middle],
                [0.0, step, (v + 0.5) / reduced - 0.5 - middle],
            ]
        )
        cv2.warpAffine(
            levels[level],
            move,
            (SIDE, SIDE),
            dst=out[n, k],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return np.concatenate(list(out.swapaxes(0, 1)), axis=3)
