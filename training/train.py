"""Train the packaged network on rendered pictures (`training.render`) and write it as ONNX.

    nice -n 19 python -m training.train --work DIR [--videos DIR] [--steps K] [--minutes M]
        [--finish M] [--device cpu|cuda] [--batch B] [--rate R] [--ring N] [--fresh] [--anew]
        [--out FILE]

Training goes on from the packaged network (--anew: from random weights). The work folder holds the
pictures and the checkpoint: the same command goes on where it was ended. Data and weights hang on
seeds, the pictures there and the step alone: with one build of torch, on a CPU, the same network
comes out. --steps sets the fall of the learning rate, --minutes ends sooner, to be resumed; with
--finish the rate falls within so many minutes, and the network hangs on the machine's speed, too.
--fresh: `training.render` goes on beside it; a shard is removed once it is in memory, where up to N
pictures are kept, of 1 MB each, the newest.
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

from companion.perception.eyes import PACKAGED
from training.average import follow
from training.crops import Batch, Crops
from training.data import LENS
from training.losses import drone_loss, drone_targets, scene_loss
from training.network import Network, export, load
from training.ring import Ring, Supply
from training.sprites import drawn_sprites
from training.videos import cut_outs, real_shard

_TEXT_EVERY = 100  # steps
_SAVE_EVERY = 120.0  # s
_SPRITES = 512  # drawn drones of each size
SEED = 6


class Training:
    """The network, its average over the last weights, and the optimiser: one checkpoint."""

    def __init__(self, steps: int, rate: float, device: str) -> None:
        """rate: of AdamW, at its highest."""
        torch.manual_seed(5)
        self.steps, self.rate, self.device = steps, rate, device
        self.network = Network().to(device, memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.network)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=rate, weight_decay=1e-4, fused=device == "cuda"
        )
        self.step = 0

    def advance(self, batch: Batch, passed: float) -> Tensor:
        """Take one step on a batch and return the two losses (2,): of drones and of the scene.

        passed: 0…1, share of the time that this training may take.
        """
        self.step += 1
        share = min(max(self.step / self.steps, passed), 1.0)
        falling = 0.005 + 0.995 * 0.5 * (1 + math.cos(math.pi * share))
        self.optimiser.param_groups[0]["lr"] = self.rate * min(1.0, self.step / 500) * falling
        losses = self._losses(*batch)
        self.optimiser.zero_grad()
        (losses[0] + 2.0 * losses[1]).backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        follow(self.average, self.network, self.step)
        return losses.detach()

    def _losses(self, pictures: Tensor, labels: Tensor, classes: Tensor) -> Tensor:
        """Return the losses (2,)."""
        with torch.autocast(self.device, torch.bfloat16, enabled=self.device == "cuda"):
            drones, scene = self.network(pictures.contiguous(memory_format=torch.channels_last))
        targets = drone_targets(labels, drones.shape[2], drones.shape[3])
        return torch.stack(
            [drone_loss(drones.float(), *targets), scene_loss(scene.float(), classes)]
        )

    def save(self, path: Path) -> None:
        """Write the checkpoint; a crash while writing leaves the last one."""
        state = {
            "step": self.step,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save(state, path.with_suffix(".new"))
        path.with_suffix(".new").replace(path)

    def begin_with(self, weights: dict[str, Tensor]) -> None:
        """Go on from a packaged network's weights, at step 0."""
        self.network.load_state_dict(weights, strict=False)
        self.average.load_state_dict(weights, strict=False)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        state = torch.load(path, map_location=self.device, weights_only=True)
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])


def main() -> None:
    """Train, export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="pictures and checkpoint")
    parser.add_argument("--videos", type=Path, help="folder of V_CLASS_NNN.mp4 and their labels")
    parser.add_argument("--steps", type=int, default=150000)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after these")
    parser.add_argument("--finish", type=float, default=math.inf, help="be done after these")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--batch", type=int, default=16, help="crops in a step (16)")
    parser.add_argument("--rate", type=float, default=2e-3, help="of learning, at its highest")
    parser.add_argument("--ring", type=int, default=8000, help="pictures in memory (8000)")
    parser.add_argument("--fresh", action="store_true", help="pictures are rendered meanwhile")
    parser.add_argument("--anew", action="store_true", help="from random weights")
    parser.add_argument("--out", type=Path, default=PACKAGED)
    options = parser.parse_args()
    begun = time.monotonic()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    training = Training(options.steps, options.rate, options.device)
    checkpoint = options.work / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"goes on from step {training.step}", flush=True)
    elif not options.anew:
        training.begin_with(load(str(PACKAGED)))
    crops = _crops(options)
    losses, saved = [], begun
    while training.step < training.steps:
        minutes = (time.monotonic() - begun) / 60
        if minutes >= min(options.minutes, options.finish):
            break
        batch = crops.batch(training.step + 1, options.batch)
        losses.append(training.advance(batch, minutes / options.finish))
        if training.step % _TEXT_EVERY == 0:
            drones, scene = torch.stack(losses).mean(dim=0).tolist()
            losses.clear()
            text = f"step {training.step}: drones {drones:.3f}, scene {scene:.4f}"
            print(f"{text}, {minutes:.2f} min, {crops.rendered.total} pictures", flush=True)
        if time.monotonic() > saved + _SAVE_EVERY:
            saved = time.monotonic()
            training.save(checkpoint)
    training.save(checkpoint)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    export(training.average, str(options.out), LENS.width, LENS.height)


def _crops(options: argparse.Namespace) -> Crops:
    """Return the crops of the pictures in the work folder.

    Raises:
        SystemExit: there are no pictures.
    """
    device = options.device
    real, cut = None, []
    if options.videos or (options.work / "real.npz").exists():
        shard = real_shard(options.work, options.videos)
        real = Ring(len(shard.pictures), *shard.pictures.shape[1:3], device)
        real.add(shard)
        cut = cut_outs(options.work, options.videos)
    sprites = drawn_sprites(options.work, cut, _SPRITES, device)
    rendered = Ring(options.ring, LENS.height, LENS.width, device)
    if options.fresh:
        Supply(options.work, rendered).start()
        while rendered.total < min(options.ring, options.batch):
            time.sleep(0.2)
    else:
        rendered.fill(options.work)
    if not rendered.count:
        raise SystemExit(f"{options.work}: no pictures; see training/render.py")
    return Crops(rendered, real, sprites, SEED)


if __name__ == "__main__":
    main()
