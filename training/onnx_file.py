"""Weights in an ONNX file, by their names in the network that was written."""

from __future__ import annotations

import torch
from torch import Tensor, nn


def weights(path: str, network: nn.Module, prefix: str = "") -> dict[str, Tensor]:
    """Return the weights of a file by their names in `network`; prefix: of the names in the file.

    Raises:
        KeyError: a file with other weights; the message names those that are missing.
    """
    import onnx

    held = {
        each.name.removeprefix(prefix): torch.from_numpy(onnx.numpy_helper.to_array(each).copy())
        for each in onnx.load(path).graph.initializer
    }
    wanted = [name for name in network.state_dict() if "num_batches" not in name]
    if missing := [name for name in wanted if name not in held]:
        raise KeyError(f"{path}: not this network's weights; missing: {', '.join(missing[:3])}")
    return {name: held[name] for name in wanted}
