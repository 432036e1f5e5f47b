"""Cut-outs made strange: mirrored, in other colours and light, blurred, noisy."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from training.closer_cuts import DU

_CONTRAST, _TINT = 0.25, 0.12  # σ of the logarithms of contrast and of each channel's gain
_GAMMA = 0.3  # σ of the logarithm
# Shares of the cut-outs that are less or more colourful, that have their channels exchanged, that
# are lit otherwise, blurred, noisy.
_COLOURED, _EXCHANGED, _LIT, _BLURRED, _NOISY = 0.5, 0.25, 0.25, 0.2, 0.3


def changed(pictures: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Return pictures (n,PLANES,h,w), 0…255, and their labels (n,5), changed at random."""
    n, labels = len(pictures), labels.clone()
    each = pictures.unflatten(1, (-1, 3))
    mean = each.mean(dim=(3, 4), keepdim=True)
    turned = _colours(n)[:, None] @ (each - mean).flatten(3)
    pictures = (turned.view(each.shape) + mean).flatten(1, 2).clamp(0, 255)
    which = _some(0.5, n)
    pictures[which] = pictures[which].flip(3)
    labels[which, DU] *= -1
    which = _some(_LIT, n)
    gamma = torch.exp(_GAMMA * torch.randn(len(which), 1, 1, 1))
    pictures[which] = 255 * (pictures[which] / 255 + 1e-4) ** gamma
    which = _some(_BLURRED, n)
    soft = avg_pool2d(pad(pictures[which], (1, 1, 1, 1), mode="replicate"), 3, 1)
    pictures[which] = 0.6 * soft + 0.4 * pictures[which]
    which = _some(_NOISY, n)
    noise = -3 * torch.rand(len(which), 1, 1, 1).clamp(min=1e-6).log()
    pictures[which] += noise * torch.randn_like(pictures[which])
    return pictures.clamp(0, 255), labels


def _colours(n: int) -> Tensor:
    """Return matrices (n,3,3): contrast, tint, paler or stronger colours, channels exchanged."""
    grey = torch.full((3, 3), 1 / 3)
    colour = torch.where(torch.rand(n, 1, 1) < _COLOURED, 1.3 * torch.rand(n, 1, 1), 1.0)
    matrix = grey + colour * (torch.eye(3) - grey)
    which = _some(_EXCHANGED, n)
    matrix[which] = matrix[which][:, torch.randperm(3)]
    gain = _CONTRAST * torch.randn(n, 1, 1) + _TINT * torch.randn(n, 3, 1)
    return matrix * torch.exp(gain)


def _some(share: float, n: int) -> Tensor:
    """Return which of n are chosen."""
    return torch.nonzero(torch.rand(n) < share)[:, 0]
