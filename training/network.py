"""The drone detector: a centre heat map at an eighth of the picture's size.

Its shape is fast in `cv2.dnn` on one core: few channels while the picture is large, plain 3×3
convolutions at stride 1, and depth-wise ones where it is made smaller.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

STRIDE = 8  # px of the picture per cell of the output
CHANNELS = 5  # heat (logit), offset u and v [cells], log size [px], log scale of its error


def _conv(inputs: int, outputs: int, size: int, stride: int = 1) -> nn.Sequential:
    """Return a convolution, normalised and rectified; the export folds the normalisation."""
    padding = size // 2
    conv = nn.Conv2d(inputs, outputs, size, stride, padding, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU())


def _halve(inputs: int, outputs: int) -> nn.Sequential:
    """Return a depth-wise convolution to half the size."""
    spatial = nn.Conv2d(inputs, inputs, 3, 2, 1, groups=inputs)
    return nn.Sequential(spatial, _conv(inputs, outputs, 1))


class Network(nn.Module):
    """The network: picture (n,3,h,w), BGR 0…1 → cells (n,CHANNELS,h/8,w/8)."""

    def __init__(self, widths: tuple[int, int, int, int] = (16, 32, 48, 64)) -> None:
        super().__init__()
        a, b, c, d = widths
        self.stem = nn.Sequential(_conv(3, a // 2, 3, 2), _conv(a // 2, a, 3, 2))
        self.eighth = nn.Sequential(_halve(a, b), _conv(b, b, 3))
        self.sixteenth = nn.Sequential(_halve(b, c), _conv(c, c, 3))
        self.last = nn.Sequential(_halve(c, d), _conv(d, d, 3))
        self.up_last, self.up_sixteenth = nn.Conv2d(d, c, 1), nn.Conv2d(c, b, 1)
        self.merge = nn.Sequential(nn.Conv2d(c, c, 3, 1, 1, groups=c), nn.ReLU(), _conv(c, c, 1))
        self.head = nn.Sequential(_conv(b, b, 3), nn.Conv2d(b, CHANNELS, 1))
        nn.init.constant_(self.head[-1].bias[:1], -4.0)  # most cells show no drone

    def forward(self, picture: Tensor) -> Tensor:
        """Return the cells of a picture."""
        eighth = self.eighth(self.stem(picture))
        sixteenth = self.sixteenth(eighth)
        wide = self.up_last(self.last(sixteenth))
        sixteenth = self.merge(sixteenth + interpolate(wide, size=sixteenth.shape[2:]))
        return self.head(eighth + interpolate(self.up_sixteenth(sixteenth), scale_factor=2))


class _Scored(nn.Module):
    """A network as flown: heat as a probability."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = copy.deepcopy(network)

    def forward(self, picture: Tensor) -> Tensor:
        out = self.network(picture)
        return torch.cat([torch.sigmoid(out[:, :1]), out[:, 1:]], dim=1)


def export(network: Network, path: str, width: int, height: int) -> None:
    """Write the network for `cv2.dnn`, with heat as a probability; width, height: px."""
    picture = torch.zeros(1, 3, height, width)
    torch.onnx.export(
        _Scored(network).eval(),
        (picture,),
        path,
        dynamo=False,
        opset_version=13,
        input_names=["picture"],
        output_names=["cells"],
    )
