"""What the network is trained to give, and how wrong an output is."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, log_softmax, one_hot, smooth_l1_loss

from training.data import FAR, GROUND, OBSTACLE, OPEN, SIZE, UNCLEAR, WANTED, U, V
from training.network import SCENE_STRIDE, STRIDE

_DISTANT = 0.3  # weight of obstacles too far to matter
_UNSIZED = 4.0  # px, of the heat's spread where a drone's size is not labelled


def drone_targets(labels: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return heat (n,h,w), and offset, log size, two weights per cell (n,5,h,w), of (n,m,4) labels.

    heat: 0…1; −1 where it is left open. Offsets [cells] and size are those of the nearest drone.
    """
    n, m = labels.shape[:2]
    row, column = torch.meshgrid(
        torch.arange(height, device=labels.device),
        torch.arange(width, device=labels.device),
        indexing="ij",
    )
    u = (labels[..., U] + 0.5) / STRIDE - 0.5
    v = (labels[..., V] + 0.5) / STRIDE - 0.5
    du = u[..., None, None] - column
    dv = v[..., None, None] - row
    sized = labels[..., SIZE] > 0
    size = torch.where(sized, labels[..., SIZE].clamp(min=0.5), _UNSIZED)
    spread = (0.13 * size / STRIDE).clamp(min=0.55)[..., None, None]
    # The cell that holds the centre has full heat.
    near = (du**2 + dv**2).sqrt()
    bump = torch.exp(-((near - 0.5).clamp(min=0) ** 2) / (2 * spread**2))
    here = (labels[..., WANTED] == 1)[..., None, None]
    open_ = (labels[..., WANTED] == 0)[..., None, None] & (near < 1.5 + 2 * spread)
    heat = (bump * here).amax(dim=1)
    heat = torch.where(open_.any(dim=1) & (heat < 0.5), -1.0, heat)
    best = (bump * here).argmax(dim=1, keepdim=True)
    known = sized.float()[..., None, None].expand(n, m, height, width)
    pick = [du, dv, size.log()[..., None, None].expand(n, m, height, width), known]
    nearest = [x.gather(1, best)[:, 0] for x in pick]
    weight = torch.where(heat > 0.4, heat, 0.0)
    return heat, torch.stack([*nearest[:3], weight, weight * nearest[3]], dim=1)


def drone_loss(out: Tensor, heat: Tensor, aim: Tensor) -> Tensor:
    """Return the loss: focal for heat, smooth for offsets, Laplacian for size and its scale."""
    p = torch.sigmoid(out[:, 0]).clamp(1e-5, 1 - 1e-5)
    hit = heat > 0.99
    positive = -((1 - p) ** 2) * p.log() * hit
    negative = -((1 - heat.clamp(min=0)) ** 4) * p**2 * (1 - p).log() * (~hit & (heat >= 0))
    count = hit.sum().clamp(min=1)
    offset = smooth_l1_loss(out[:, 1:3], aim[:, :2], reduction="none", beta=0.2).sum(dim=1)
    log_scale = out[:, 4].clamp(-5.0, 1.0)
    size = (out[:, 3] - aim[:, 2]).abs() * torch.exp(-log_scale) + log_scale
    placed = (aim[:, 3] * offset).sum() / aim[:, 3].sum().clamp(min=1)
    sized = (aim[:, 4] * size).sum() / aim[:, 4].sum().clamp(min=1)
    return (positive + negative).sum() / count + placed + 0.5 * sized


def scene_loss(out: Tensor, classes: Tensor) -> Tensor:
    """Return the cross-entropy of logits (n,3,h,w) with the classes (n,H,W) of the pixels.

    A cell on an edge has a share of each class, so that an edge lies between cells. Unclear
    pixels have a third of each.
    """
    obstacle = (classes == OBSTACLE) | (classes == FAR)
    index = torch.where(obstacle, 0, torch.where(classes == GROUND, 1, 2))
    known = (classes != OPEN).float() * torch.where(classes == FAR, _DISTANT, 1.0)
    shares = one_hot(index, 3).permute(0, 3, 1, 2).float()
    shares = torch.where((classes == UNCLEAR)[:, None], 1 / 3, shares)
    weighed = avg_pool2d(shares * known[:, None], SCENE_STRIDE)
    return -(weighed * log_softmax(out, dim=1)).sum() / weighed.sum().clamp(min=1)
