"""What the companions of a scenario sense, and with which lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mavlink_bridge.shared.frames import quaternion_from_euler
from mavlink_bridge.shared.settings import Contradiction, SettingsError, StrictModel
from sitl_sim.sensors.fisheye import Lens


class DepthConfig(StrictModel):
    """The depth image of airframes that carry such a sensor: the camera's view, coarser."""

    width: int = Field(160, ge=32, le=640, description="px; the height follows the camera's.")
    range: float = Field(10.0, gt=0, description="Farthest measurement [m].")
    noise: float = Field(
        0.01, ge=0, le=0.5, description="1 σ as a share of the distance; stereo has 1–2 % at 4 m."
    )


Span = float | Annotated[list[float], Field(min_length=2, max_length=2)]


class ActualCameraConfig(StrictModel):
    """How the cameras truly differ from what the companions are told; nobody is.

    [least, most]: each drone draws its own.
    """

    roll_deg: Span = Field(0.0, description="Turned about its axis, clockwise as it sees [°].")
    pitch_deg: Span = Field(0.0, description="Looks up [°].")
    yaw_deg: Span = Field(0.0, description="Looks to the left [°].")
    focal: Span = Field(1.0, description="Factor on the focal length.")
    stamp: Span = Field(0.0, description="s by which stamps are after the capture.")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for key in type(self).model_fields:
            low, high = _ends(getattr(self, key))
            least, most = _LIMITS[key]
            if not least <= low <= high <= most:
                text = f"takes {least:g}…{most:g}, or [least, most] in it"
                raise Contradiction((key,), text)
        return self

    def drawn(self, count: int, seed: int) -> list[ActualCamera]:
        """Return each drone's camera; the seed draws what is drawn."""
        columns = {}
        for purpose, key in enumerate(type(self).model_fields):
            rng = np.random.default_rng([seed, 0xCA, purpose])
            columns[key] = rng.uniform(*_ends(getattr(self, key)), count)
        return [ActualCamera(**{k: float(v[i]) for k, v in columns.items()}) for i in range(count)]


@dataclass(frozen=True)
class ActualCamera:
    """One drone's true camera, in the units of `ActualCameraConfig`."""

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    focal: float
    stamp: float

    @property
    def turn(self) -> NDArray[np.float64]:
        """Quaternion (4,), body as the camera is mounted → body."""
        roll, pitch, yaw = np.radians([self.roll_deg, -self.pitch_deg, self.yaw_deg])
        return quaternion_from_euler(float(roll), float(pitch), float(yaw))


_LIMITS = {
    "roll_deg": (-45.0, 45.0),
    "pitch_deg": (-45.0, 45.0),
    "yaw_deg": (-45.0, 45.0),
    "focal": (0.5, 2.0),
    "stamp": (-0.3, 0.3),
}


def _ends(span: float | list[float]) -> tuple[float, float]:
    """Return the least and the largest value."""
    return (span[0], span[1]) if isinstance(span, list) else (span, span)


class SensingConfig(StrictModel):
    """What the companions sense."""

    neighbours: Literal["camera", "truth"] = "camera"
    obstacles: Literal["camera", "depth", "map"] = "camera"
    eyes: Literal["color", "network"] = Field(
        "color",
        description="By what companions find in pictures what they are to find there. color: "
        "magenta balls, and trunks by their colours; network: drones and obstacles as they are.",
    )
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
    actual: ActualCameraConfig = Field(
        ActualCameraConfig(), description="How the cameras truly are; no companion is told."
    )
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
