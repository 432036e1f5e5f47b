"""The pictures that crops are cut from: on the training's device, the oldest replaced by new."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Thread

import torch

from training.data import MOST, Shard, complete, load, remove


class Ring:
    """Up to `capacity` pictures of one size.

    pictures: (capacity,h,w,4) BGR and class. drones: (capacity,MOST,4). brightness: (capacity,)
    mean of the whole picture, 0…255. count: pictures there. total: pictures ever added.
    """

    def __init__(self, capacity: int, height: int, width: int, device: str) -> None:
        self.pictures = torch.empty((capacity, height, width, 4), dtype=torch.uint8, device=device)
        self.drones = torch.empty((capacity, MOST, 4), device=device)
        self.brightness = torch.empty(capacity, device=device)
        self.total = 0

    @property
    def count(self) -> int:
        """Return how many pictures are there."""
        return min(self.total, len(self.pictures))

    def add(self, shard: Shard) -> None:
        """Add a shard's pictures; what does not fit at the end goes to the beginning."""
        device = self.pictures.device
        pictures = torch.from_numpy(shard.pictures).to(device)
        drones = torch.from_numpy(shard.drones).to(device)
        brightness = pictures[:, ::8, ::8, :3].float().mean(dim=(1, 2, 3))
        done, capacity = 0, len(self.pictures)
        while done < len(pictures):
            at = self.total % capacity
            n = min(len(pictures) - done, capacity - at)
            self.pictures[at : at + n] = pictures[done : done + n]
            self.drones[at : at + n] = drones[done : done + n]
            self.brightness[at : at + n] = brightness[done : done + n]
            done += n
            self.total += n

    def fill(self, folder: Path) -> None:
        """Add the shards of a folder, in order."""
        for name in complete(folder):
            self.add(load(folder, name))


class Supply(Thread):
    """Moves shards from a folder into a ring while the training runs, and removes their files."""

    def __init__(self, folder: Path, ring: Ring) -> None:
        super().__init__(daemon=True)
        self._folder, self._ring = folder, ring

    def run(self) -> None:
        """Move what is complete, for ever."""
        stream = torch.cuda.Stream() if self._ring.pictures.is_cuda else None
        with torch.cuda.stream(stream):
            while True:
                names = complete(self._folder)
                for name in names:
                    self._ring.add(load(self._folder, name))
                    if stream is not None:
                        stream.synchronize()
                    remove(self._folder, name)
                if not names:
                    time.sleep(0.2)
