"""What the companions of a scenario sense, and with which lens."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mavlink_bridge.shared.settings import SettingsError, StrictModel
from sitl_sim.sensors.fisheye import Lens


class DepthConfig(StrictModel):
    """The depth image of airframes that carry such a sensor: the camera's view, coarser."""

    width: int = Field(160, ge=32, le=640, description="px; the height follows the camera's.")
    range: float = Field(10.0, gt=0, description="Farthest measurement [m].")
    noise: float = Field(
        0.01, ge=0, le=0.5, description="1 σ as a share of the distance; stereo has 1–2 % at 4 m."
    )


class SensingConfig(StrictModel):
    """What the companions sense."""

    neighbours: Literal["camera", "truth"] = "camera"
    obstacles: Literal["camera", "depth", "map"] = "camera"
    width: int = Field(640, ge=64, le=1920)
    height: int = Field(400, ge=64, le=1200)
    fov_deg: float = Field(160.0, gt=10, lt=200)
    range_max: float = Field(15.0, gt=0, description="R of eq. (6) for truth and map [m].")
    latency: float = Field(
        0.02,
        ge=0,
        le=0.08,
        description="From capture to delivery [s]: exposure, read-out, transfer. In lockstep "
        "pictures are rendered meanwhile.",
    )
    depth: DepthConfig = DepthConfig()
    calibration: str | None = Field(
        None,
        description="Calibration file of all cameras, read by the simulator and by each "
        "companion; width and height must be those of the file.",
    )


def lens_of(sensing: SensingConfig) -> Lens:
    """Return the lens of all cameras.

    Raises:
        SettingsError: the calibration cannot be used, or is of another image size.
    """
    if sensing.calibration is None:
        return Lens(sensing.width, sensing.height, sensing.fov_deg)
    try:
        lens = Lens.load(sensing.calibration)
    except ValueError as error:
        raise SettingsError([f"sensing.calibration: {error}"]) from error
    if (lens.width, lens.height) != (sensing.width, sensing.height):
        made = f"made at {lens.width}×{lens.height}, frames are {sensing.width}×{sensing.height}"
        raise SettingsError([f"sensing.calibration: {sensing.calibration}: {made}"])
    return lens
