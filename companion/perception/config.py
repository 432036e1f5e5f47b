"""Configuration of the camera and of what is looked for in its frames."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from companion.perception.depth import DepthConfig
from companion.perception.heat_map import HeatMapConfig, NetworkConfig
from companion.perception.marker_colour import ColorSettings
from companion.perception.object_fit import FootSettings
from companion.perception.trunk_fit import TrunkSettings
from companion.perception.yolo import YoloConfig
from mavlink_bridge.shared.parts import PartKind
from mavlink_bridge.shared.settings import StrictModel

_PACKAGED = "companion.perception.detectors"
DETECTORS = PartKind(
    "detector",
    "swarm_companion.detectors",
    {name: f"{_PACKAGED}:{name}" for name in ("color", "cnn", "network", "yolo")},
    (frozenset({"detect"}),),
)

SOURCE_FORMS = (
    "sim:HOST:PORT, device:N, device:/dev/NAME, rtsp://ADDRESS, gst:PIPELINE or file:PATH"
)
_FORMS = (r"sim:[^:]+:[0-9]{1,5}", r"device:([0-9]+|/.+)", r"rtsp://.+", r"gst:.+", r"file:.+")


def check_source(source: str) -> str:
    """The source itself where it is well formed.

    Raises:
        ValueError: naming the valid forms.
    """
    if not any(re.fullmatch(form, source) for form in _FORMS):
        raise ValueError(f"must be {SOURCE_FORMS}")
    kind, _, address = source.partition(":")
    if kind == "sim" and not 0 < int(address.rpartition(":")[2]) < 65536:
        raise ValueError(f"must be {SOURCE_FORMS}; a port is 1 to 65535")
    return source


Angle = Annotated[float, Field(ge=-180, le=180)]


class CameraConfig(StrictModel):
    """Where frames come from and how the lens images."""

    source: Annotated[str, AfterValidator(check_source)] = Field(
        "sim:127.0.0.1:15541", description=SOURCE_FORMS
    )
    latency: float = Field(
        0.03, ge=0, le=0.5, description="s from exposure to arrival, where a camera does not say."
    )
    lag: float = Field(
        0.0,
        ge=-0.3,
        le=0.3,
        description="s by which pictures are older than their stamps say (below 0: younger); the "
        "rest is measured in flight.",
    )
    mount_deg: list[Angle] = Field(
        [0.0, 0.0, 0.0],
        min_length=3,
        max_length=3,
        description="Roll, pitch, yaw [°] by which the camera is turned from straight ahead, or "
        "from the calibration's mount: clockwise, up, to the left.",
    )
    width: int = Field(640, ge=64, le=4096, description="px.")
    height: int = Field(400, ge=64, le=4096, description="px.")
    fov_deg: float = Field(160.0, gt=10, lt=240, description="Across the width, equidistant.")
    calibration: str | None = Field(
        None,
        description="Calibration file, relative to this one; the three above must fit it.",
    )


class SensingConfig(StrictModel):
    """What the tracker and the obstacle memory are fed with."""

    neighbours: Literal["camera", "truth"] = "camera"
    obstacles: Literal["camera", "network", "depth", "map"] = Field(
        "camera",
        description="camera: trunks by their colours; network: by the packaged network; depth: by "
        "a depth camera; map: for studies.",
    )
    detector: Annotated[str, AfterValidator(DETECTORS.check)] = Field(
        "color",
        description="color: drones with a marker; network: the packaged network, drones as they "
        "are; cnn: the one before; yolo: a network of your own; your own detector by the name of "
        "its entry point, or module:Class.",
    )
    detector_options: dict[str, Any] = Field({}, description="Passed to your own detector.")
    model: str | None = Field(
        None,
        description="ONNX file, relative to this one: for yolo, or a cnn or network trained anew.",
    )
    network: NetworkConfig = NetworkConfig()
    color: ColorSettings = ColorSettings()
    cnn: HeatMapConfig = HeatMapConfig()
    yolo: YoloConfig = YoloConfig()
    trunks: TrunkSettings = TrunkSettings()
    feet: FootSettings = FootSettings()
    trunks_every: int = Field(
        2, ge=1, le=10, description="Frames from one look for trunks to the next: they stand still."
    )
    parallax: bool = Field(
        True, description="Whether corners of the picture show obstacles by the own motion, too."
    )
    depth: DepthConfig = DepthConfig()

    @property
    def uses_network(self) -> bool:
        """Whether the packaged network looks at each picture."""
        drones = self.neighbours == "camera" and self.detector == "network"
        return drones or self.obstacles == "network"
