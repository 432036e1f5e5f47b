"""Objects to paste into crops: drawn drones, and objects cut from real videos, at several sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from training.augment import blurred
from training.data import DRONE, OPEN, SIZE, SMALLEST, UNCLEAR, WANTED, U, V
from training.dice import Dice
from training.shapes import drawn_drone
from training.videos import CutOut

RADII = (2.75, 5.5, 11.0, 22.0, 44.0)  # px, of the objects; pasted at half to all of it
_ENLARGED = 1.6  # most that a cut-out may be
_SHARE = 0.1  # of the crops that get one of a radius


class Pasted(NamedTuple):
    """A batch to paste into: pictures (n,3,h,w), labels (n,m,4), classes (n,h,w)."""

    pictures: Tensor
    labels: Tensor
    classes: Tensor


@dataclass(frozen=True)
class Sprites:
    """Objects of one radius [px].

    images: (k,4,s,s) BGR times opacity, and opacity, 0…255. drones: (k,) whether it is one.
    drawn: the first so many are drawn, the others cut out.
    """

    radius: float
    images: Tensor
    drones: Tensor
    drawn: int

    def paste(self, dice: Dice, to: Pasted) -> Tensor:
        """Paste one object into some of the crops; return labels (n,1,4)."""
        n, _, height, width = to.pictures.shape
        k = max(round(_SHARE * n), 1)
        crop = dice.some(k, n)
        size = self.radius * dice.even(0.5, 1.0, k)
        side = self.images.shape[-1]
        x, y = dice.below(width - side, k), dice.below(height - side, k)
        part = dice.uniform(-0.5, 0.5, k, 2)
        chosen = self._chosen(dice, k)
        picture, opacity = self._drawn(dice, chosen, self.radius / size, part)
        u, v = x + (side - 1) / 2 + part[:, 0], y + (side - 1) / 2 + part[:, 1]
        allowed = self._free(to, crop, u, v, size)
        opacity = opacity * allowed[:, None, None, None]
        rows = y[:, None, None] + torch.arange(side, device=y.device)[:, None]
        columns = x[:, None, None] + torch.arange(side, device=x.device)
        where = crop[:, None, None], rows, columns
        below = to.pictures.permute(0, 2, 3, 1)[where].permute(0, 3, 1, 2)
        over = _laid_over(dice, below, picture, opacity)
        to.pictures.permute(0, 2, 3, 1)[where] = over.permute(0, 2, 3, 1)
        old = to.classes[where]
        covered = (opacity[:, 0] > 0.4) & (old != OPEN)
        to.classes[where] = torch.where(covered, DRONE, old).to(to.classes.dtype)
        wanted = torch.where(size >= SMALLEST, 1.0, 0.0)
        wanted = torch.where(allowed & self.drones[chosen], wanted, -1.0)
        labels = torch.full((n, 1, 4), -1.0, device=to.labels.device)
        labels[crop, 0] = torch.stack([u, v, size, wanted], dim=1)
        return labels

    def _chosen(self, dice: Dice, k: int) -> Tensor:
        """Return which objects (k,): half of them are cut out, where there are any."""
        total = len(self.images)
        drawn, cut = dice.below(self.drawn, k), self.drawn + dice.below(total - self.drawn, k)
        return torch.where(dice.chance(0.5, k) & (total > self.drawn), cut, drawn)

    def _drawn(
        self, dice: Dice, chosen: Tensor, shrunk: Tensor, part: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return pictures (k,3,s,s) and opacities (k,1,s,s), shrunk, moved by a part of a pixel."""
        k, side = len(chosen), self.images.shape[-1]
        steps = (torch.arange(2 * side, device=part.device) + 0.5) / 2 - side / 2
        mirrored = torch.where(dice.chance(0.5, k), -1.0, 1.0)
        u = (steps - part[:, :1]) * (shrunk * mirrored)[:, None] * (2 / side)
        v = (steps - part[:, 1:]) * shrunk[:, None] * (2 / side)
        grid = torch.stack(
            [u[:, None].expand(k, len(steps), -1), v[:, :, None].expand(k, -1, len(steps))], dim=3
        )
        images = grid_sample(self.images[chosen].float(), grid, align_corners=False)
        images = avg_pool2d(images, 2)
        soft = torch.where(dice.chance(0.6, k), dice.uniform(0.4, 1.1, k), 0.1)
        images = blurred(images, soft)
        opacity = images[:, 3:] / 255
        picture = images[:, :3] / opacity.clamp(min=1e-3)
        other = dice.chance(0.5, k)[:, None, None, None]
        gain = (0.5 * dice.normal(k, 1, 1, 1)).exp()
        brighter = gain * picture + dice.uniform(-20, 60, k, 1, 1, 1)
        return torch.where(other, brighter, picture).clamp(0, 255), opacity

    def _free(self, to: Pasted, crop: Tensor, u: Tensor, v: Tensor, size: Tensor) -> Tensor:
        """Return whether nothing labelled is near the places (k,), and the crop shows something."""
        there = to.labels[crop]
        near = torch.hypot(there[..., U] - u[:, None], there[..., V] - v[:, None])
        reach = size[:, None] + there[..., SIZE].abs().clamp(min=12) + 4
        taken = ((near < reach) & (there[..., WANTED] >= 0)).any(dim=1)
        return ~taken & (to.classes[crop, 0, 0] != UNCLEAR)


def paste(dice: Dice, sprites: Sequence[Sprites], to: Pasted) -> Tensor:
    """Paste objects of all sizes into the batch and return its labels (n,more,4)."""
    for each in sprites:
        labels = torch.cat([to.labels, each.paste(dice, to)], dim=1)
        to = to._replace(labels=labels)
    return to.labels


def _laid_over(dice: Dice, below: Tensor, picture: Tensor, opacity: Tensor) -> Tensor:
    """Return what is below (k,3,s,s) with pictures over it, as grainy as it is itself.

    Without this, whatever is cleaner than its surroundings would look like a drone.
    """
    grain = below - torch.nn.functional.avg_pool2d(below, 3, 1, 1, count_include_pad=False)
    sigma = 1.5 * grain.abs().flatten(1).median(dim=1).values[:, None, None, None]
    noisy = picture + sigma * dice.normal(*picture.shape)
    return (below * (1 - opacity) + opacity * noisy).clamp(0, 255)


def drawn_sprites(folder: Path, cut: list[CutOut], count: int, device: str) -> list[Sprites]:
    """Return the objects of all radii: `count` drawn of each, and what was cut out.

    The drawn ones are kept in the folder.
    """
    file = folder / f"sprites-{count}.npz"
    if not file.exists():
        rng = np.random.default_rng(83)
        made = {
            f"r{n}": np.stack([_packed(*drawn_drone(rng, radius)) for _ in range(count)])
            for n, radius in enumerate(RADII)
        }
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(file, **made)  # type: ignore[arg-type]
    held = np.load(file)
    result = []
    for n, radius in enumerate(RADII):
        drawn = held[f"r{n}"]
        fitting = [c for c in cut if _ENLARGED * max(c.opacity.shape) / 2 >= radius]
        rows = [drawn, *(_fitted(c, radius, drawn.shape[-1])[None] for c in fitting)]
        drones = torch.tensor([True] * count + [c.drone for c in fitting], device=device)
        images = torch.from_numpy(np.concatenate(rows)).to(device)
        result.append(Sprites(radius, images, drones, count))
    return result


def _packed(picture: NDArray[np.uint8], opacity: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return (4,h,w): BGR times opacity, and opacity, 0…255."""
    layers = [*np.moveaxis(picture * opacity[..., None], 2, 0), 255 * opacity]
    return np.clip(np.stack(layers), 0, 255).astype(np.uint8)


def _fitted(cut: CutOut, radius: float, side: int) -> NDArray[np.uint8]:
    """Return a cut-out (4,side,side), its longer side two radii, in the middle."""
    whole = _packed(cut.picture, cut.opacity).transpose(1, 2, 0)
    k = 2 * radius / max(cut.opacity.shape)
    w, h = (max(round(k * length), 1) for length in cut.opacity.shape[::-1])
    how = cv2.INTER_AREA if k < 1 else cv2.INTER_LINEAR
    top, left = (side - h) // 2, (side - w) // 2
    placed = np.zeros((side, side, 4), np.uint8)
    placed[top : top + h, left : left + w] = cv2.resize(whole, (w, h), interpolation=how)
    return placed.transpose(2, 0, 1)
