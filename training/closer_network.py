"""The network of the closer look (`companion.perception.closer_look`).

Its input is normalised cut-out by cut-out, the wider ones for themselves: how bright a picture is,
and how rich in contrast, tells nothing, and what stands out little is seen as well as what stands
out much.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import dropout, relu

from companion.perception.closer_look import AROUND, CHANNELS, PLANES, SIDE, WIDER
from training.network import conv
from training.onnx_file import weights

WIDTHS = (16, 32, 64)
_PLACED = 24  # channels of which the place in the cut-out counts
# Shares that are left out in training: of what the search says, and of what is judged by.
_HIDDEN, _DROPPED = 0.3, 0.2
_GREY = 64.0  # grey levels that are one unit
_LEAST = 0.01  # variance [units²] that noise alone has


class _Refine(nn.Module):
    """A residual block of one convolution."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, cells: Tensor) -> Tensor:
        return relu(cells + self.norm(self.conv(cells)))


class CloserNetwork(nn.Module):
    """The network: cut-outs (n,PLANES,SIDE,SIDE) BGR 0…255, and what is around → (n,CHANNELS)."""

    def __init__(self, widths: tuple[int, int, int] = WIDTHS) -> None:
        super().__init__()
        a, b, c = widths
        self.layers = nn.Sequential(
            *(conv(PLANES, a, 3, 2), _Refine(a)),
            *(conv(a, b, 3, 2), _Refine(b), _Refine(b)),
            *(conv(b, c, 3, 2), _Refine(c)),
        )
        cells = SIDE // 8
        self.place = nn.Conv2d(c, _PLACED, 1)
        self.around = nn.Sequential(nn.BatchNorm1d(AROUND), nn.Linear(AROUND, 64), nn.ReLU())
        self.all = nn.Sequential(
            nn.Linear(_PLACED * cells * cells + c + 64, 96), nn.ReLU(), nn.Dropout(_DROPPED)
        )
        self.out = nn.Linear(96, CHANNELS)

    def forward(self, cut: Tensor, around: Tensor) -> Tensor:
        """Return logit, offset, log ratio and log scale of cut-outs; around (n,AROUND)."""
        cut = (cut / _GREY).unflatten(1, (len(WIDER), 3))
        mean = cut.mean(dim=(2, 3, 4), keepdim=True)
        spread = ((cut - mean) ** 2).mean(dim=(2, 3, 4), keepdim=True)
        cells = self.layers(((cut - mean) / torch.sqrt(spread + _LEAST)).flatten(1, 2))
        # Without it the network would know the worlds that it is trained on by their features.
        said = self.around(dropout(around, _HIDDEN, self.training))
        seen = relu(self.place(cells)).flatten(1), cells.mean(dim=(2, 3)), said
        out: Tensor = self.out(self.all(torch.cat(seen, dim=1)))
        return out


def export(network: CloserNetwork, path: str) -> None:
    """Write the network as ONNX: `cut_outs`, `around` → `drones`, see `forward`."""
    torch.onnx.export(
        network.eval(),
        (torch.zeros(2, PLANES, SIDE, SIDE), torch.zeros(2, AROUND)),
        path,
        dynamo=False,
        opset_version=13,
        input_names=["cut_outs", "around"],
        output_names=["drones"],
        dynamic_axes={name: {0: "n"} for name in ("cut_outs", "around", "drones")},
        training=torch.onnx.TrainingMode.PRESERVE,
        do_constant_folding=False,
    )


def load(path: str) -> dict[str, Tensor]:
    """Return the weights of a network that `export` wrote.

    Raises:
        KeyError: a file with other weights; the message names those that are missing.
    """
    return weights(path, CloserNetwork())
