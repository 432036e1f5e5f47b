"""The packaged network: drones and the classes of the scene, in one pass over a picture.

Drones are a centre heat map at an eighth of the picture's size; the scene is the class of each cell
at a quarter of it. Few channels while the picture is large, plain 3×3 convolutions at stride 1 and
depth-wise ones where the picture is made smaller are fastest on one core, in floating point: int8
took 1.2 to 2 times as long in ONNX Runtime 1.32 on a server core with VNNI.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn.functional import conv_transpose2d, interpolate, relu

from training.onnx_file import weights

STRIDE, SCENE_STRIDE = 8, 4  # px of the picture per cell
CHANNELS = 5  # heat (logit), offset u and v [cells], log size [px], log scale of its error
CLASSES = 3  # logits: obstacle, ground, other (sky, drones)
WIDTHS = (16, 32, 64, 128)
_PREFIX = "network."  # of the weights' names in a file


def conv(inputs: int, outputs: int, size: int, stride: int = 1, groups: int = 1) -> nn.Sequential:
    """Return a convolution, normalised and rectified; the export folds the normalisation."""
    layer = nn.Conv2d(inputs, outputs, size, stride, size // 2, groups=groups, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs), nn.ReLU())


def _halve(inputs: int, outputs: int) -> nn.Sequential:
    """Return a depth-wise convolution to half the size."""
    spatial = nn.Conv2d(inputs, inputs, 3, 2, 1, groups=inputs)
    return nn.Sequential(spatial, conv(inputs, outputs, 1))


def _shuffled(layer: nn.Conv2d, cells: Tensor) -> Tensor:
    """Return pixel_shuffle(layer(cells), 2) of a 1×1 convolution with four outputs to a channel.

    As one transposed convolution, which ONNX Runtime runs in half of the time.
    """
    channels = layer.out_channels // 4
    weight = layer.weight.reshape(channels, 2, 2, -1).permute(3, 0, 1, 2)
    assert layer.bias is not None
    biases = layer.bias.reshape(1, channels, 2, 2).repeat(1, 1, *cells.shape[2:])
    return conv_transpose2d(cells, weight, stride=2) + biases


class _Refine(nn.Module):
    """A residual block of one dense convolution; it changes nothing before it is trained."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        nn.init.zeros_(self.norm.weight)

    def forward(self, cells: Tensor) -> Tensor:
        refined: Tensor = cells + self.norm(self.conv(relu(cells)))
        return refined


class _Wide(nn.Module):
    """A residual block with a view of five cells."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        spatial = nn.Conv2d(channels, channels, 5, 1, 2, groups=channels)
        self.inner = nn.Sequential(spatial, conv(channels, channels, 1))

    def forward(self, cells: Tensor) -> Tensor:
        return cells + self.inner(cells)


class Network(nn.Module):
    """The network: picture (n,3,h,w), BGR 0…1 → drones (n,5,h/8,w/8), scene (n,3,h/4,w/4)."""

    def __init__(self, widths: tuple[int, int, int, int] = WIDTHS) -> None:
        super().__init__()
        a, b, c, d = widths
        fine = 12
        self.stem = nn.Sequential(conv(3, a // 2, 3, 2), conv(a // 2, a, 3, 2))
        self.eighth = nn.Sequential(_halve(a, b), conv(b, b, 3), _Refine(b))
        self.sixteenth = nn.Sequential(_halve(b, c), conv(c, c, 3), _Refine(c), _Refine(c))
        self.last = nn.Sequential(_halve(c, d), conv(d, d, 3), _Wide(d), _Wide(d))
        self.up_last, self.up_sixteenth = nn.Conv2d(d, c, 1), nn.Conv2d(c, b, 1)
        self.merge = nn.Sequential(nn.Conv2d(c, c, 3, 1, 1, groups=c), nn.ReLU(), conv(c, c, 1))
        self.refine = nn.Sequential(_Refine(b), _Refine(b))
        self.drones = nn.Sequential(conv(b, b, 3), nn.Conv2d(b, CHANNELS, 1))
        self.coarse, self.fine = nn.Conv2d(b, 4 * fine, 1), nn.Conv2d(a, fine, 1)
        self.scene = nn.Sequential(
            nn.ReLU(),
            nn.Conv2d(fine, fine, 3, 1, 1, groups=fine),
            nn.ReLU(),
            nn.Conv2d(fine, CLASSES, 1),
        )
        nn.init.constant_(self.drones[-1].bias[:1], -4.0)  # most cells show no drone

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """Return the drones' cells and the scene's classes of a picture."""
        drones, scene, _ = self.looked(picture)
        return drones, scene

    def looked(self, picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the same, and what the drones' cells are made from (n,b,h/8,w/8)."""
        quarter = self.stem(picture)
        eighth = self.eighth(quarter)
        sixteenth = self.sixteenth(eighth)
        wide = self.up_last(self.last(sixteenth))
        sixteenth = self.merge(sixteenth + interpolate(wide, size=sixteenth.shape[2:]))
        eighth = eighth + interpolate(self.up_sixteenth(sixteenth), size=eighth.shape[2:])
        eighth = self.refine(eighth)
        scene = self.scene(_shuffled(self.coarse, eighth) + self.fine(quarter))
        return self.drones(eighth), scene, eighth


class _Flown(nn.Module):
    """A network as flown: bytes in, heat and classes as probabilities out."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = copy.deepcopy(network).cpu()

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        drones, scene, features = self.network.looked(picture)
        cells = torch.cat([torch.sigmoid(drones[:, :1]), drones[:, 1:]], dim=1)
        # As `torch.softmax`, which ONNX Runtime runs in three times as long over channels.
        odds = torch.exp(scene - scene.amax(dim=1, keepdim=True))
        return cells, (odds / odds.sum(dim=1, keepdim=True))[:, :2], features


def export(network: Network, path: str, width: int, height: int) -> None:
    """Write the network as ONNX: `picture` (1,3,h,w) → `drones`, `scene`, `features`.

    width, height: px. Weights keep their names and normalisations, so that training can go on from
    the file (`load`).
    """
    torch.onnx.export(
        _Flown(network).eval(),
        (torch.zeros(1, 3, height, width),),
        path,
        dynamo=False,
        opset_version=13,
        input_names=["picture"],
        output_names=["drones", "scene", "features"],
        training=torch.onnx.TrainingMode.PRESERVE,
        do_constant_folding=False,
    )


def load(path: str) -> dict[str, Tensor]:
    """Return the weights of a network that `export` wrote, by their names in `Network`.

    Raises:
        KeyError: a file with other weights; the message names those that are missing.
    """
    return weights(path, Network(), _PREFIX)
