"""Train the packaged network and write it as ONNX.

    nice -n 19 python -m training.train --work DIR [--videos DIR] [--shards N] [--steps K]
        [--minutes M] [--finish M] [--device cpu|cuda] [--workers W] [--batch B] [--rate R] [--anew]
        [--out FILE]

Training goes on from the packaged network (--anew: from random weights). The work folder keeps
pictures and the checkpoint: the same command goes on where it was ended. Data and weights hang on
seeds and the step alone: with one build of torch, on a CPU, the same network comes out. --steps
sets the fall of the learning rate, --minutes ends sooner, to be resumed; with --finish the rate
falls within so many minutes, and the network hangs on the machine's speed, too. --workers processes
render and cut pictures beside the training: on a GPU, as many as there are cores.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from companion.perception.eyes import PACKAGED
from training.crops import Batch, Crops
from training.data import LENS, rendered_shard
from training.losses import drone_loss, drone_targets, scene_loss
from training.network import Network, export, load
from training.videos import cut_outs, real_shard

_TEXT_EVERY = 100  # steps
SAVE_EVERY = 250  # steps
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

    def advance(self, batch: Sequence[Tensor], passed: float) -> Tensor:
        """Take one step on a batch and return the two losses (2,): of drones and of the scene.

        batch: as `Batch`. passed: 0…1, share of the time that this training may take.
        """
        self.step += 1
        share = min(max(self.step / self.steps, passed), 1.0)
        falling = 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share))
        self.optimiser.param_groups[0]["lr"] = self.rate * min(1.0, self.step / 300) * falling
        pictures, gains, labels, classes = (x.to(self.device, non_blocking=True) for x in batch)
        lit = (pictures * gains[:, None, None, None]).permute(0, 3, 1, 2)  # channels last in memory
        drones, scene = self.network(lit)
        of_drones = drone_loss(drones, *drone_targets(labels, *drones.shape[2:]))
        of_scene = scene_loss(scene, classes)
        self.optimiser.zero_grad()
        (of_drones + 2.0 * of_scene).backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        self._follow(1 - min(0.998, self.step / (self.step + 10)))
        return torch.stack([of_drones, of_scene]).detach()

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


class Batches(IterableDataset[Batch]):
    """The batches of steps first…last; each of several workers makes its share, in order."""

    def __init__(self, crops: Crops, first: int, last: int, size: int) -> None:
        super().__init__()
        self._crops, self._steps, self._size = crops, range(first, last + 1), size

    def __iter__(self) -> Iterator[Batch]:
        cv2.setNumThreads(1)
        worker = get_worker_info()
        start, step = (0, 1) if worker is None else (worker.id, worker.num_workers)
        for number in self._steps[start::step]:
            yield self._crops.batch(number, self._size)


def main() -> None:
    """Render missing data, train, export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="pictures and checkpoint")
    parser.add_argument("--videos", type=Path, help="folder of V_CLASS_NNN.mp4 and their labels")
    parser.add_argument("--shards", type=int, default=80, help="of 250 rendered pictures (80)")
    parser.add_argument("--steps", type=int, default=150000)
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after these")
    parser.add_argument("--finish", type=float, default=math.inf, help="be done after these")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--workers", type=int, default=0, help="processes for pictures (0)")
    parser.add_argument("--batch", type=int, default=16, help="crops in a step (16)")
    parser.add_argument("--rate", type=float, default=2e-3, help="of learning, at its highest")
    parser.add_argument("--anew", action="store_true", help="from random weights")
    parser.add_argument("--out", type=Path, default=PACKAGED)
    options = parser.parse_args()
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
    batches = Batches(crops, training.step + 1, options.steps, options.batch)
    loader = DataLoader(
        batches,
        batch_size=None,
        num_workers=options.workers,
        collate_fn=_tensors,
        prefetch_factor=4 if options.workers else None,
        pin_memory=options.device == "cuda",
    )
    begun, losses = time.monotonic(), []
    for batch in loader:
        minutes = (time.monotonic() - begun) / 60
        losses.append(training.advance(batch, minutes / options.finish))
        if training.step % _TEXT_EVERY == 0:
            drones, scene = torch.stack(losses[-_TEXT_EVERY:]).mean(dim=0).tolist()
            losses.clear()
            text = f"step {training.step}: drones {drones:.3f}, scene {scene:.4f}"
            print(f"{text}, {minutes:.1f} min", flush=True)
        if training.step % SAVE_EVERY == 0:
            training.save(checkpoint)
        if minutes >= min(options.minutes, options.finish):
            break
    training.save(checkpoint)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    export(training.average, str(options.out), LENS.width, LENS.height)


def _tensors(batch: Batch) -> tuple[Tensor, ...]:
    """Return the batch as tensors: they come from a worker without being copied through a pipe."""
    return tuple(torch.from_numpy(each) for each in batch)


def _crops(options: argparse.Namespace) -> Crops:
    """Return the crops of all pictures; those that are missing are rendered first."""
    if options.workers > 1:
        with get_context("spawn").Pool(options.workers) as pool:
            for done, _ in enumerate(
                pool.imap_unordered(partial(_render, options.work), range(options.shards)), 1
            ):
                print(f"{done} of {options.shards} shards", flush=True)
    rendered = [rendered_shard(options.work, seed) for seed in range(options.shards)]
    real = real_shard(options.work, options.videos) if options.videos else None
    cut = cut_outs(options.work, options.videos) if options.videos else []
    return Crops(rendered, real, cut, SEED)


def _render(folder: Path, seed: int) -> int:
    """Render a shard where it is missing, and return its seed: the arrays stay on disk."""
    cv2.setNumThreads(1)
    rendered_shard(folder, seed)
    return seed


if __name__ == "__main__":
    main()
