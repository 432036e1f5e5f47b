"""The brightness that networks were trained at."""

from __future__ import annotations

from companion.types import Image

_BRIGHTNESS = 0.4  # mean of a picture, 0…1


def exposure_gain(image: Image) -> float:
    """Return the gain of a picture (H,W,3) uint8 to the brightness of training, 0.5…3."""
    mean = float(image[::8, ::8].mean()) / 255
    return min(max(_BRIGHTNESS / max(mean, 1e-3), 0.5), 3.0)
