"""Random numbers on the device of a training, by seed and step."""

from __future__ import annotations

import math

import torch
from torch import Tensor


class Dice:
    """Draws tensors; the same numbers for the same seed and step, on one device and build."""

    def __init__(self, device: str, seed: int, step: int) -> None:
        self.device = device
        self._generator = torch.Generator(device).manual_seed(1_000_003 * seed + step)

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Return numbers from low to high."""
        drawn = torch.rand(shape, generator=self._generator, device=self.device)
        return low + (high - low) * drawn

    def even(self, low: float, high: float, *shape: int) -> Tensor:
        """Return numbers from low to high, as many in each octave."""
        return self.uniform(math.log(low), math.log(high), *shape).exp()

    def normal(self, *shape: int) -> Tensor:
        """Return numbers of unit variance."""
        return torch.randn(shape, generator=self._generator, device=self.device)

    def chance(self, share: float, *shape: int) -> Tensor:
        """Return True for a share."""
        return torch.rand(shape, generator=self._generator, device=self.device) < share

    def below(self, end: int | Tensor, *shape: int) -> Tensor:
        """Return whole numbers 0…end−1."""
        drawn = torch.rand(shape, generator=self._generator, device=self.device)
        return (drawn * end).long()

    def some(self, count: int, of: int) -> Tensor:
        """Return `count` different numbers (count,) of 0…of−1."""
        return torch.randperm(of, generator=self._generator, device=self.device)[:count]

    def one_of(self, weights: Tensor) -> Tensor:
        """Return a column (n,) for each row of weights (n,m), the likelier the heavier."""
        return torch.multinomial(weights, 1, generator=self._generator)[:, 0]
