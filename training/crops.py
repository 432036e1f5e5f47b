"""Random crops of rendered and real pictures, as the network takes them in training.

All crops of a batch are made at once, on the training's device. Half of the rendered ones are cut
as they are, without a pixel being interpolated: so the network will see pictures in flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from training.augment import Strange
from training.data import SMALLEST, UNCLEAR, WANTED, U, V
from training.dice import Dice
from training.ring import Ring
from training.sprites import Pasted, Sprites, paste

CROP = (256, 320)  # px, height and width
_REAL = 0.15  # share of crops that are photographs
_REPAINTED = 0.3  # share of rendered crops
_ZOOM, _REAL_ZOOM = (0.65, 1.5), (0.8, 2.2)
_BOX = 12.0  # px, longer side of a box; drones in smaller ones are left open
_BRIGHTNESS = 0.4  # as `companion.perception.exposure`


class Batch(NamedTuple):
    """Pictures (n,3,h,w) BGR 0…1, lit as in flight, labels (n,m,4), classes (n,h,w)."""

    pictures: Tensor
    labels: Tensor
    classes: Tensor


class Crops:
    """Crops by seed and step.

    rendered, real: pictures; the real ones have no classes. real: None: there are none.
    """

    def __init__(
        self, rendered: Ring, real: Ring | None, sprites: Sequence[Sprites], seed: int
    ) -> None:
        self.rendered, self.real, self._sprites, self._seed = rendered, real, sprites, seed
        self._device = str(rendered.pictures.device)
        photographs = None if real is None else real.pictures[: real.count]
        self._strange = Strange(photographs, seed, self._device)

    @torch.no_grad()
    def batch(self, step: int, size: int) -> Batch:
        """Return the batch of a step."""
        dice = Dice(self._device, self._seed, step)
        photographs = 0 if self.real is None else max(round(_REAL * size), 1)
        drawn = size - photographs
        parts = [
            _cut(dice, self.rendered, (drawn + 1) // 2, None),
            _cut(dice, self.rendered, drawn // 2, _ZOOM),
        ]
        if self.real is not None:
            parts.append(_cut(dice, self.real, photographs, _REAL_ZOOM))
        image, labels, classes, whole = (torch.cat(p) for p in zip(*parts, strict=True))
        some = dice.some(round(_REPAINTED * drawn), drawn)
        painted = self._strange.repaint(dice, image[some], classes[some])
        image[some] = torch.where((classes[some, :1, :1] == UNCLEAR)[:, None], image[some], painted)
        labels = paste(dice, self._sprites, Pasted(image, labels, classes))
        before = _mean(image)
        image = self._strange.light(dice, image)
        after = _mean(image)
        # The camera exposes for the whole picture, of which a crop is a part.
        mean = torch.where(dice.chance(0.6, size), whole * after / before.clamp(min=1.0), after)
        gain = (_BRIGHTNESS * 255 / mean.clamp(min=0.3)).clamp(0.5, 3.0)
        gain = gain * (0.12 * dice.normal(size)).exp() / 255
        return Batch(image * gain[:, None, None, None], labels, classes)


def _mean(image: Tensor) -> Tensor:
    return image[..., ::8, ::8].mean(dim=(1, 2, 3))


def _cut(
    dice: Dice, ring: Ring, count: int, zooms: tuple[float, float] | None
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return parts of random pictures at CROP (n,3,h,w), labels, classes, and the brightness.

    zooms: least and most; None: the parts are as in the picture.
    """
    device = ring.pictures.device
    height, width = ring.pictures.shape[1:3]
    which = dice.below(ring.count, count)
    zoom = torch.ones(count, device=device) if zooms is None else dice.even(*zooms, count)
    h, w = (CROP[0] / zoom).clamp(max=height), (CROP[1] / zoom).clamp(max=width)
    labels = ring.drones[which]
    x, y = _corner(dice, labels, height, width, h, w)
    if zooms is None:
        x, y = x.floor(), y.floor()
    mirrored = torch.where(dice.chance(0.5, count), -1.0, 1.0)
    # Places in the picture, in pixels, of the crop's rows and columns.
    rows = (torch.arange(CROP[0], device=device) + 0.5) / CROP[0] * h[:, None] + y[:, None] - 0.5
    across = (torch.arange(CROP[1], device=device) + 0.5) / CROP[1] - 0.5
    middle = x + w / 2 - 0.5
    columns = middle[:, None] + across * (w * mirrored)[:, None]
    at = (
        which[:, None, None],
        rows.round().long().clamp(0, height - 1)[:, :, None],
        columns.round().long().clamp(0, width - 1)[:, None],
    )
    taken = ring.pictures[at]
    classes = taken[..., 3].contiguous()
    if zooms is None:
        image = taken[..., :3].permute(0, 3, 1, 2).float().contiguous()
    else:
        image = _sampled(ring.pictures[which], rows, columns, h / CROP[0], w / CROP[1] * mirrored)
    return image, _moved(labels, x, y, h, w, mirrored), classes, ring.brightness[which]


def _sampled(pictures: Tensor, rows: Tensor, columns: Tensor, dv: Tensor, du: Tensor) -> Tensor:
    """Return pictures (n,h,w,4) at rows and columns of places dv, du [px] apart, two for each."""
    height, width = pictures.shape[1:3]

    def twice(places: Tensor, step: Tensor, length: int) -> Tensor:
        both = torch.stack([places - step[:, None] / 4, places + step[:, None] / 4], dim=2)
        return (both.flatten(1) + 0.5) * (2 / length) - 1

    v, u = twice(rows, dv, height), twice(columns, du, width)
    shape = len(rows), v.shape[1], u.shape[1]
    grid = torch.stack([u[:, None].expand(shape), v[:, :, None].expand(shape)], dim=3)
    planes = pictures[..., :3].permute(0, 3, 1, 2).float()
    fine = grid_sample(planes, grid, padding_mode="border", align_corners=False)
    return avg_pool2d(fine, 2)


def _corner(
    dice: Dice, labels: Tensor, height: int, width: int, h: Tensor, w: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the corner x, y (n,) of parts h, w (n,); most that can, show a wanted drone."""
    n = len(labels)
    x, y = dice.uniform(0, 1, n) * (width - w), dice.uniform(0, 1, n) * (height - h)
    wanted = (labels[..., WANTED] == 1).float()
    chosen = dice.one_of(wanted + 1e-6)
    place = labels[torch.arange(n, device=labels.device), chosen]
    towards = dice.chance(0.6, n) & (wanted.sum(dim=1) > 0)
    x = torch.where(towards, place[:, U] - dice.uniform(0.1, 0.9, n) * w, x)
    y = torch.where(towards, place[:, V] - dice.uniform(0.1, 0.9, n) * h, y)
    zero = torch.zeros((), device=x.device)
    return torch.clamp(x, zero, width - w), torch.clamp(y, zero, height - h)


def _moved(labels: Tensor, x: Tensor, y: Tensor, h: Tensor, w: Tensor, mirrored: Tensor) -> Tensor:
    """Return labels (n,m,4) of pictures as those of their parts, mirrored (−1) or not (1)."""
    x, y, h, w, mirrored = (each[:, None] for each in (x, y, h, w, mirrored))
    ku, kv = CROP[1] / w, CROP[0] / h
    u, v, size, wanted = labels.unbind(dim=2)
    u = (u - (x + w / 2 - 0.5)) * ku * mirrored + (CROP[1] - 1) / 2
    v = (v - y + 0.5) * kv - 0.5
    size = size * (ku * kv).sqrt()
    small = ((size > 0) & (size < SMALLEST)) | ((size < 0) & (size > -_BOX))
    wanted = torch.where((wanted == 1) & small, 0.0, wanted)
    out = (u < -0.5) | (v < -0.5) | (u > CROP[1] - 0.5) | (v > CROP[0] - 0.5)
    return torch.stack([u, v, size, torch.where(out, -1.0, wanted)], dim=2)
