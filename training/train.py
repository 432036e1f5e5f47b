"""Train the packaged network and write it as ONNX.

    nice -n 19 python -m training.train --work DIR [--videos DIR] [--shards N] [--steps K]
        [--minutes M] [--device cpu|cuda] [--out FILE]

The work folder keeps pictures and the checkpoint: the same command goes on where it was ended.
Data and weights hang on seeds and the step alone: with one build of torch, one thread and the same
steps, the same network comes out. --steps sets the fall of the learning rate; --minutes ends
sooner, to be resumed.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import cv2
import numpy as np
import torch

from training.crops import Crops
from training.data import LENS, rendered_shard
from training.losses import drone_loss, drone_targets, scene_loss
from training.network import Network, export
from training.videos import cut_outs, real_shard

BATCH = 16
RATE = 3e-3  # of AdamW, at its highest
SAVE_EVERY = 250  # steps
SEED = 6


class Training:
    """The network, its average over the last weights, and the optimiser: one checkpoint."""

    def __init__(self, steps: int, device: str) -> None:
        torch.manual_seed(5)
        self.steps, self.device = steps, device
        self.network = Network().to(device, memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.network)
        self.optimiser = torch.optim.AdamW(self.network.parameters(), lr=RATE, weight_decay=1e-4)
        self.step = 0

    def advance(self, crops: Crops) -> tuple[float, float]:
        """Take one step and return the two losses: of drones and of the scene."""
        self.step += 1
        share = min(self.step / self.steps, 1.0)
        falling = 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share))
        self.optimiser.param_groups[0]["lr"] = RATE * min(1.0, self.step / 300) * falling
        batch = crops.batch(self.step, BATCH)
        pictures, gains = (torch.from_numpy(x).to(self.device) for x in batch[:2])
        lit = (pictures * gains[:, None, None, None]).permute(0, 3, 1, 2)  # channels last in memory
        drones, scene = self.network(lit)
        labels, classes = torch.from_numpy(batch.labels), torch.from_numpy(batch.classes)
        heat, aim = (x.to(self.device) for x in drone_targets(labels, *drones.shape[2:]))
        of_drones = drone_loss(drones, heat, aim)
        of_scene = scene_loss(scene, classes.to(self.device))
        self.optimiser.zero_grad()
        (of_drones + 2.0 * of_scene).backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        self._follow(1 - min(0.998, self.step / (self.step + 10)))
        return of_drones.item(), of_scene.item()

    @torch.no_grad()
    def _follow(self, share: float) -> None:
        """Move the average's weights and statistics towards the network's."""
        fast = self.network.state_dict()
        for name, slow in self.average.state_dict().items():
            if slow.is_floating_point():
                slow.lerp_(fast[name], share)

    def save(self, path: Path) -> None:
        """Write the checkpoint; a crash while writing leaves the last one."""
        state = {
            "step": self.step,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        torch.save(state, path.with_suffix(".new"))
        path.with_suffix(".new").replace(path)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        state = torch.load(path, map_location=self.device, weights_only=True)
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])


def main() -> None:
    """Render missing data, train, export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="pictures and checkpoint")
    parser.add_argument("--videos", type=Path, help="folder of V_CLASS_NNN.mp4 and their labels")
    parser.add_argument("--shards", type=int, default=40, help="of 250 rendered pictures")
    parser.add_argument("--steps", type=int, default=40000)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after these")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--out", type=Path, default=Path("companion/perception/models/eyes.onnx"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    rendered = []
    for seed in range(options.shards):
        rendered.append(rendered_shard(options.work, seed))
        print(f"shard {seed + 1} of {options.shards}", flush=True)
    real = real_shard(options.work, options.videos) if options.videos else None
    cut = cut_outs(options.work, options.videos) if options.videos else []
    crops = Crops(rendered, real, cut, SEED)
    training = Training(options.steps, options.device)
    checkpoint = options.work / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"goes on from step {training.step}", flush=True)
    begun, losses = time.monotonic(), []
    minutes = 0.0
    while training.step < options.steps and minutes < options.minutes:
        losses.append(training.advance(crops))
        minutes = (time.monotonic() - begun) / 60
        if training.step % 100 == 0:
            drones, scene = np.mean(losses[-100:], axis=0)
            print(
                f"step {training.step}: drones {drones:.3f}, scene {scene:.4f}, {minutes:.1f} min",
                flush=True,
            )
        if training.step % SAVE_EVERY == 0:
            training.save(checkpoint)
    training.save(checkpoint)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    export(training.average, str(options.out), LENS.width, LENS.height)


if __name__ == "__main__":
    main()
