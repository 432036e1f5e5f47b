"""Pictures made strange: other ground, bark and sky, other light, other sensors.

What a class looks like is drawn anew for each crop: one colour, a mottled texture or part of a
photograph replaces it, while the render's light and shade stay. Colours then tell nothing, and the
network has to use outlines and places. Pictures are (n,3,h,w) BGR, 0…255, in floating point.
"""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv2d, pad

from training.data import DRONE, FAR, GROUND, OBSTACLE, OTHER
from training.dice import Dice

_SIDE = 512  # px of a mottled texture
# Of gain, gamma and tint (σ of the logarithm). The rendered looks vary already: what is then made
# much brighter, harder or noisier shows drones that nobody can see, and teaches to guess.
_LIGHT = 0.15
_GROUPS = (GROUND,), (OBSTACLE, FAR), (OTHER,), (DRONE,)
_BLURRED, _PACKED = 0.2, 0.1  # shares of the crops
# The luminance table of JPEG (ITU-T T.81, table K.1).
_QUANTA = """16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56
14 17 22 29 51 87 80 62 18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92
49 64 78 87 103 121 120 101 72 92 95 98 112 100 103 99"""


class Strange:
    """Random looks and light.

    photographs: (n,h,w,4) BGR and class, that give backgrounds and textures; None: there are none.
    """

    def __init__(self, photographs: Tensor | None, seed: int, device: str) -> None:
        rng = np.random.default_rng([seed, 82])
        self._photographs = photographs
        mottled = np.stack([_mottled(rng) for _ in range(40)])
        self._mottled = torch.from_numpy(mottled)[..., None].to(device)
        orders = [np.eye(3, dtype=np.float32)[list(p)] for p in itertools.permutations(range(3))]
        self._orders = torch.from_numpy(np.stack(orders)).to(device)
        cross = np.cross(np.eye(3), np.full(3, 3**-0.5)).astype(np.float32)
        self._cross = torch.from_numpy(cross).to(device)
        self._quanta = torch.tensor([float(x) for x in _QUANTA.split()], device=device).view(8, 8)
        k = torch.arange(8.0, device=device)
        cosines = torch.cos((2 * k + 1) * k[:, None] * math.pi / 16) / 2
        self._cosines = torch.where(k[:, None] == 0, 8**-0.5, cosines)

    def repaint(self, dice: Dice, image: Tensor, classes: Tensor) -> Tensor:
        """Return the pictures with each class of their pixels, some of the time, made another."""
        n = len(image)
        grey = _grey(image)
        out = image
        for group in _GROUPS:
            mask = torch.stack([classes == one for one in group]).any(dim=0)[:, None]
            chosen = dice.chance(0.5 if group == (DRONE,) else 0.75, n, 1, 1, 1)
            level = (grey * mask).sum((2, 3)) / mask.sum((2, 3)).clamp(min=1)
            power = dice.uniform(0.2, 1.5, n, 1, 1, 1)
            shade = ((grey + 8) / (level[..., None, None] + 8)) ** power
            painted = (self._texture(dice, n, *image.shape[2:]) * shade).clamp(0, 255)
            share = dice.uniform(0.5, 1.0, n, 1, 1, 1)
            out = torch.where(mask & chosen, torch.lerp(image, painted, share), out)
        return out

    def light(self, dice: Dice, image: Tensor) -> Tensor:
        """Return the pictures in other light, through another lens and sensor."""
        n, _, height, width = image.shape
        gamma, gain = (_LIGHT * dice.normal(2, n, 1, 1)).exp()
        spread = torch.where(dice.chance(0.5, n, 1), _LIGHT, 0.03)
        tint = (spread * dice.normal(n, 3)).exp()
        hazy = dice.chance(0.15, n, 1, 1)
        low = torch.where(hazy, dice.uniform(-0.1, 0.2, n, 1, 1), 0.0)
        turn = self._colours(dice, n) * ((1 - low.clamp(min=0)) * gain) * tint[:, None]
        values = (image / 255).clamp(min=1e-4) ** gamma[..., None]
        lit = torch.baddbmm(low, turn, values.flatten(2)).view(n, 3, height, width)
        image = (255 * lit).clamp(0, 255)
        some = dice.some(max(round(_BLURRED * n), 1), n)
        image = image.index_copy(0, some, self._moved(dice, image[some]))
        sigma = torch.where(
            dice.chance(0.4, n, 1, 1, 1), -3 * dice.uniform(1e-6, 1, n, 1, 1, 1).log(), 0
        )
        image = (image + sigma * dice.normal(*image.shape)).clamp(0, 255)
        some = dice.some(max(round(_PACKED * n), 1), n)
        image = image.index_copy(0, some, self._packed(dice, image[some]))
        return image.round()

    def _colours(self, dice: Dice, n: int) -> Tensor:
        """Return matrices (n,3,3): few turn all hues, exchange the channels or make all grey."""
        plain = torch.eye(3, device=self._orders.device).expand(n, 3, 3)
        along = torch.full((3, 3), 1 / 3, device=plain.device)
        angle = dice.uniform(0, 2 * math.pi, n, 1, 1)
        strength = dice.uniform(0.2, 1.5, n, 1, 1)
        turned = along + strength * (angle.cos() * (plain - along) + angle.sin() * self._cross)
        kind = dice.uniform(0, 1, n, 1, 1)
        exchanged = self._orders[dice.below(len(self._orders), n)]
        odd = torch.where(kind < 0.1, turned, torch.where(kind < 0.15, exchanged, along))
        return torch.where(kind < 0.2, odd, plain)

    def _moved(self, dice: Dice, image: Tensor) -> Tensor:
        """Return the pictures out of focus, or smeared by motion during the exposure."""
        n = len(image)
        smeared = dice.chance(0.25, n)
        sigma = torch.where(smeared, 0.4, dice.uniform(0.3, 0.9, n))
        reach = torch.where(smeared, dice.uniform(0.5, 3.0, n), 0.0)
        return blurred(image, sigma, reach, dice.uniform(0, math.pi, n))

    def _packed(self, dice: Dice, image: Tensor) -> Tensor:
        """Return the pictures after JPEG, without its halved colours."""
        n, _, height, width = image.shape
        quality = dice.uniform(25, 90, n)
        scale = torch.where(quality < 50, 50 / quality, 2 - quality / 50)
        quanta = (self._quanta * scale.view(n, 1, 1, 1, 1, 1)).clamp(min=1)
        grey = _grey(image)
        layers = torch.cat([grey, 0.564 * (image[:, :1] - grey), 0.713 * (image[:, 2:] - grey)], 1)
        blocks = layers.view(n, 3, height // 8, 8, width // 8, 8).transpose(3, 4)
        waves = self._cosines @ blocks @ self._cosines.T
        blocks = self._cosines.T @ ((waves / quanta).round() * quanta) @ self._cosines
        y, blue, red = blocks.transpose(3, 4).reshape(n, 3, height, width).unbind(1)
        b, r = y + blue / 0.564, y + red / 0.713
        return torch.stack([b, (y - 0.114 * b - 0.299 * r) / 0.587, r], dim=1).clamp(0, 255)

    def _texture(self, dice: Dice, n: int, height: int, width: int) -> Tensor:
        """Return textures (n,3,h,w)."""
        spread = torch.where(dice.chance(0.5, n, 1), 5.0, 40.0)
        colour = (dice.uniform(20, 230, n, 1) + spread * dice.normal(n, 3)).clamp(5, 250)
        part = _windows(dice, self._mottled, n, height, width)
        contrast = dice.uniform(5, 60, n, 1) + 12 * dice.normal(n, 3)
        kind = dice.uniform(0, 1, n, 1, 1, 1)
        flat = colour[..., None, None]
        texture = torch.where(kind < 0.25, flat, flat + part * contrast[..., None, None])
        if self._photographs is not None:
            photo = _windows(dice, self._photographs, n, height, width)[:, :3].float()
            texture = torch.where(kind > 0.75, photo, texture)
        return texture


def blurred(
    image: Tensor, sigma: Tensor, reach: Tensor | None = None, angle: Tensor | None = None
) -> Tensor:
    """Return pictures (n,c,h,w) blurred by σ (n,) [px] and along ±reach (n,) at an angle (n,)."""
    n, c = image.shape[:2]
    radius = 3
    steps = torch.arange(-radius, radius + 1, device=image.device, dtype=image.dtype)
    v, u = steps[:, None], steps
    along, across = u.expand(n, len(steps), -1), v.expand(n, -1, len(steps))
    if reach is not None and angle is not None:
        cos, sin = angle.cos()[:, None, None], angle.sin()[:, None, None]
        along, across = (u * cos + v * sin).abs() - reach[:, None, None], v * cos - u * sin
        along = along.clamp(min=0)
    kernel = (-(along**2 + across**2) / (2 * sigma[:, None, None] ** 2)).exp()
    kernel = kernel / kernel.sum((1, 2), keepdim=True)
    kernel = kernel.repeat_interleave(c, 0)[:, None]
    padded = pad(image, (radius, radius, radius, radius), mode="replicate")
    height, width = padded.shape[2:]
    out = conv2d(padded.reshape(1, n * c, height, width), kernel, groups=n * c)
    return out.view(image.shape)


def _windows(dice: Dice, images: Tensor, n: int, height: int, width: int) -> Tensor:
    """Return random parts (n,c,height,width) of images (m,h,w,c)."""
    m, h, w, _ = images.shape
    y, x = dice.below(h - height + 1, n), dice.below(w - width + 1, n)
    rows = y[:, None] + torch.arange(height, device=images.device)
    columns = x[:, None] + torch.arange(width, device=images.device)
    which = dice.below(m, n)[:, None, None]
    return images[which, rows[:, :, None], columns[:, None]].permute(0, 3, 1, 2)


def _grey(image: Tensor) -> Tensor:
    b, g, r = image[:, :1], image[:, 1:2], image[:, 2:]
    return 0.114 * b + 0.587 * g + 0.299 * r


def _mottled(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return noise (_SIDE,_SIDE) of unit variance with a random spectrum and grain."""
    out = np.zeros((_SIDE, _SIDE), np.float32)
    slope = float(rng.uniform(0.3, 1.5))
    stretch = float(np.exp(rng.normal(0, 0.8)))
    for octave in range(2, 10):
        n = 2**octave
        across = max(2, min(_SIDE, int(n * stretch)))
        coarse = rng.standard_normal((n, across)).astype(np.float32)
        out += cv2.resize(coarse, (_SIDE, _SIDE), interpolation=cv2.INTER_CUBIC) * n**-slope
    return out / out.std()
