"""The average over a network's last weights, which is steadier than any of them."""

from __future__ import annotations

import torch
from torch import nn


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, step: int) -> None:
    """Move the average's weights and statistics towards the network's, after a step (1, 2, …)."""
    slow, fast = average.state_dict(), network.state_dict()
    names = [name for name in slow if slow[name].is_floating_point()]
    share = 1 - min(0.999, step / (step + 10))
    torch._foreach_lerp_([slow[n] for n in names], [fast[n] for n in names], share)
