"""Train the closer look on rendered pictures (`training.render`) and write it as ONNX.

    nice python -m training.closer --work DIR --videos DIR [--minutes M] [--threads K]
        [--anew] [--out FILE]

The work folder holds the pictures; their cut-outs are made once, and kept there: then the pictures
are no longer needed. Training goes on from the packaged network (--anew: from random weights). The
learning rate falls within --minutes, so the network hangs on the machine's speed.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import cv2
import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from companion.perception.closer_look import PACKAGED
from training.average import follow
from training.closer_augment import changed
from training.closer_cuts import DRONE, DU, DV, RATIO, SIZED, Cuts, Cutter, joined
from training.closer_cuts import load as load_cuts
from training.closer_cuts import save as save_cuts
from training.closer_network import CloserNetwork, export, load
from training.data import complete
from training.data import load as load_shard

# Of a batch: drones and other places in renders; drones, other things that fly, the rest in videos.
_BATCH = (100, 156, 40, 40, 24)
_RATE = 2e-3  # of AdamW, at its highest
_PLACE, _SIZE = 2.0, 0.2  # weights of the losses
_TEXT_EVERY = 1000  # steps
_SEED = 6


class Pool:
    """Cut-outs by kind: pictures, what is around them, and labels of each."""

    def __init__(self) -> None:
        self.kinds: list[tuple[Tensor, ...]] = []

    def add(self, cuts: Cuts, chosen: list[Tensor]) -> None:
        """Add a kind of cut-outs for each mask (n,)."""
        held = [torch.from_numpy(each) for each in (cuts.pictures, cuts.around, cuts.labels)]
        self.kinds += [tuple(each[mask] for each in held) for mask in chosen]

    def batch(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return a batch: pictures (n,PLANES,h,w), what is around (n,AROUND), labels (n,5)."""
        parts = []
        for kind, count in zip(self.kinds, _BATCH, strict=False):
            which = torch.randint(len(kind[0]), (count,))
            parts.append([each[which] for each in kind])
        pictures, said, labels = (torch.cat(each) for each in zip(*parts, strict=True))
        pictures, labels = changed(pictures.permute(0, 3, 1, 2).float(), labels)
        return pictures, said.float(), labels


def losses(out: Tensor, labels: Tensor) -> Tensor:
    """Return the losses (3,): of being a drone or not, of the place, and of the size."""
    drone = labels[:, DRONE]
    sized = drone * labels[:, SIZED]
    off = (out[:, 1:3] - labels[:, [DU, DV]]).abs().sum(dim=1)
    scale = out[:, 4].clamp(-5.0, 1.0)
    size = (out[:, 3] - labels[:, RATIO]).abs() * torch.exp(-scale) + scale
    return torch.stack(
        [
            binary_cross_entropy_with_logits(out[:, 0], drone),
            (drone * off).sum() / drone.sum().clamp(min=1),
            (sized * size).sum() / sized.sum().clamp(min=1),
        ]
    )


def pool(work: Path, source: Path | None) -> Pool:
    """Return the cut-outs of the work folder; those that are missing are made first.

    Raises:
        SystemExit: there are no pictures.
    """
    for name in complete(work):
        file = work / f"cuts-{name}.npz"
        if not file.exists():
            save_cuts(file, Cutter(int(name.rpartition("-")[2])).shard(load_shard(work, name)))
    files = sorted(work.glob("cuts-looks-*[0-9].npz"))
    if not files:
        raise SystemExit(f"{work}: no pictures; see training/render.py")
    made = Pool()
    rendered = joined(load_cuts(file) for file in files)
    drone = torch.from_numpy(rendered.labels[:, DRONE] == 1)
    made.add(rendered, [drone, ~drone])
    if source is not None:
        file = work / "cuts-real.npz"
        if not file.exists():
            save_cuts(file, Cutter(_SEED).real(source))
        real = load_cuts(file)
        drone, other = torch.from_numpy(real.labels[:, DRONE] == 1), torch.from_numpy(real.others)
        made.add(real, [drone, ~drone & other, ~drone & ~other])
    return made


def train(network: CloserNetwork, made: Pool, minutes: float) -> CloserNetwork:
    """Train for so many minutes and return the average over the last weights."""
    average = copy.deepcopy(network)
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=1e-3)
    begun, step, summed = time.monotonic(), 0, torch.zeros(3)
    while (share := (time.monotonic() - begun) / 60 / minutes) < 1:
        step += 1
        falling = 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share))
        optimiser.param_groups[0]["lr"] = _RATE * min(1.0, step / 200) * falling
        pictures, said, labels = made.batch()
        with torch.autocast("cpu", torch.bfloat16):
            out = network(pictures.contiguous(memory_format=torch.channels_last), said)
        parts = losses(out.float(), labels)
        optimiser.zero_grad()
        (parts[0] + _PLACE * parts[1] + _SIZE * parts[2]).backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        follow(average, network, step)
        summed += parts.detach()
        if step % _TEXT_EVERY == 0:
            drone, place, size = (summed / _TEXT_EVERY).tolist()
            print(f"step {step}: drone {drone:.3f}, place {place:.4f}, size {size:.3f}", flush=True)
            summed.zero_()
    return average


def main() -> None:
    """Cut, train, export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="pictures and cut-outs")
    parser.add_argument("--videos", type=Path, help="folder of V_CLASS_NNN.mp4 and their labels")
    parser.add_argument("--minutes", type=float, default=45.0)
    parser.add_argument("--threads", type=int, default=1, help="of the processor (1)")
    parser.add_argument("--anew", action="store_true", help="from random weights")
    parser.add_argument("--out", type=Path, default=PACKAGED)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(_SEED)
    cv2.setNumThreads(1)
    made = pool(options.work, options.videos)
    network = CloserNetwork().to(memory_format=torch.channels_last)
    if not options.anew:
        network.load_state_dict(load(str(PACKAGED)), strict=False)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    export(train(network, made, options.minutes), str(options.out))


if __name__ == "__main__":
    main()
