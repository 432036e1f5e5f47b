"""Train the packaged detector and write it as ONNX.

    nice -n 15 python -m training.train --work DIR [--shards N] [--steps K] [--minutes M] [--out F]

Seeds of data and weights are fixed: with one build of torch the same steps give the same network.
The command prints the number of steps, which --minutes may end. It writes the file every few
hundred steps, from an average over the last weights.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from companion.perception.cnn import PACKAGED
from training.data import LENS, SIZE, WANTED, Crops, U, V, shard
from training.network import STRIDE, Network, export

BATCH = 16
RATE = 3e-3  # of AdamW, at its highest
EXPORT_EVERY = 500


def targets(labels: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return heat (n,h,w), and offset, log size, weight per cell (n,4,h,w), of labels (n,m,4).

    heat: 0…1; −1 where it is left open. Offsets [cells] and size are those of the nearest drone.
    """
    n, m = labels.shape[:2]
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    u = (labels[..., U] + 0.5) / STRIDE - 0.5
    v = (labels[..., V] + 0.5) / STRIDE - 0.5
    du = u[..., None, None] - column
    dv = v[..., None, None] - row
    size = labels[..., SIZE].clamp(min=0.5)
    spread = (0.13 * size / STRIDE).clamp(min=0.55)[..., None, None]
    # The cell that holds the centre has full heat.
    near = (du**2 + dv**2).sqrt()
    bump = torch.exp(-((near - 0.5).clamp(min=0) ** 2) / (2 * spread**2))
    here = (labels[..., WANTED] == 1)[..., None, None]
    open_ = (labels[..., WANTED] == 0)[..., None, None] & (near < 1.5 + 2 * spread)
    heat = (bump * here).amax(dim=1)
    heat = torch.where(open_.any(dim=1) & (heat < 0.5), torch.tensor(-1.0), heat)
    best = (bump * here).argmax(dim=1, keepdim=True)
    pick = [du, dv, size.log()[..., None, None].expand(n, m, height, width)]
    nearest = [x.gather(1, best)[:, 0] for x in pick]
    weight = torch.where(heat > 0.4, heat, torch.tensor(0.0))
    return heat, torch.stack([*nearest, weight], dim=1)


def loss(out: Tensor, heat: Tensor, aim: Tensor) -> Tensor:
    """Return the loss: focal for heat, smooth for offsets, Laplacian for size and its scale."""
    p = torch.sigmoid(out[:, 0]).clamp(1e-5, 1 - 1e-5)
    hit = heat > 0.99
    positive = -((1 - p) ** 2) * p.log() * hit
    negative = -((1 - heat.clamp(min=0)) ** 4) * p**2 * (1 - p).log() * (~hit & (heat >= 0))
    count = hit.sum().clamp(min=1)
    weight = aim[:, 3]
    total = weight.sum().clamp(min=1)
    offset = smooth_l1_loss(out[:, 1:3], aim[:, :2], reduction="none", beta=0.2).sum(dim=1)
    log_scale = out[:, 4].clamp(-5.0, 1.0)
    size = (out[:, 3] - aim[:, 2]).abs() * torch.exp(-log_scale) + log_scale
    return (positive + negative).sum() / count + (weight * (offset + 0.5 * size)).sum() / total


def lit(pictures: Tensor, gains: Tensor) -> Tensor:
    """Return crops (n,h,w,3) uint8 times gains (n,) as (n,3,h,w) in random light, some noisier."""
    n = len(pictures)
    gain = torch.empty(n, 1, 1, 3).uniform_(0.92, 1.08)
    gain *= torch.empty(n, 1, 1, 1).uniform_(0.85, 1.15) * gains[:, None, None, None]
    out = pictures * (gain / 255) + 0.03 * torch.randn(n, 1, 1, 1)
    noisy = slice(0, n // 3)  # crops come in random order
    out[noisy] += torch.empty(n, 1, 1, 1).uniform_(0, 0.03)[noisy] * torch.randn(out[noisy].shape)
    return out.clamp(min=0).permute(0, 3, 1, 2)


@torch.no_grad()
def _follow(average: Network, network: Network, share: float) -> None:
    """Move the average's weights and statistics towards the network's."""
    pairs = zip(average.state_dict().values(), network.state_dict().values(), strict=True)
    for slow, fast in pairs:
        if slow.is_floating_point():
            slow.lerp_(fast, share)


def main() -> None:
    """Render missing data, train, export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for the pictures")
    parser.add_argument("--shards", type=int, default=40, help="of 250 pictures")
    parser.add_argument("--steps", type=int, default=20000)
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="end after these, if sooner"
    )
    parser.add_argument("--out", type=Path, default=PACKAGED)
    options = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(5)
    files = []
    for seed in range(options.shards):
        files.append(shard(options.work, seed))
        print(f"shard {seed + 1} of {options.shards}", flush=True)
    crops = Crops(files, seed=6)
    network = Network()
    average = copy.deepcopy(network)
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-4)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    begun, losses = time.monotonic(), []
    share, step = 0.0, 0
    while share < 1.0:
        step += 1
        minutes = (time.monotonic() - begun) / 60
        share = max(step / options.steps, minutes / options.minutes)
        falling = 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(share, 1.0)))
        optimiser.param_groups[0]["lr"] = RATE * min(1.0, step / 200) * falling
        pictures, labels, gains = (torch.from_numpy(x) for x in crops.batch(BATCH))
        out = network(lit(pictures, gains))
        value = loss(out, *targets(labels, out.shape[2], out.shape[3]))
        optimiser.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        keep = min(0.998, step / (step + 10))
        _follow(average, network, 1 - keep)
        losses.append(float(value))
        if step % 100 == 0:
            mean = np.mean(losses[-100:])
            print(f"step {step}, loss {mean:.3f}, {minutes:.1f} min", flush=True)
        if step % EXPORT_EVERY == 0 or share >= 1.0:
            export(average, str(options.out), LENS.width, LENS.height)


if __name__ == "__main__":
    main()
