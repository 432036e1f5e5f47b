"""One drone's configuration: default ← airframe ← drone, validated as a whole.

`default.yaml` beside a drone's file (or none) lies below `airframes/NAME.yaml`, which lies
below the drone's own file. Angles that a person writes are in degrees and say so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from companion.baselines.config import BaselinesConfig, Controller
from companion.consistency import contradictions
from companion.depth import DepthConfig
from companion.detect import ColorSettings
from companion.eye import EyeConfig
from companion.framesource import SOURCE_FORMS, check_source
from companion.gaze import GazeConfig
from companion.guard import GuardConfig
from companion.heatmap import CnnConfig
from companion.mission import MissionConfig
from companion.nmpc import NmpcConfig
from companion.obstacles import ObstacleConfig
from companion.reciprocity import ReciprocityConfig
from companion.surfaces import SurfaceConfig
from companion.threat import ThreatConfig
from companion.track import TrackerConfig
from companion.trunks import TrunkSettings
from companion.types import Vector
from companion.yolo import YoloConfig
from mavlink_bridge.autopilots import AutopilotName
from mavlink_bridge.link import ENDPOINT_FORMS, parse_endpoint
from mavlink_bridge.messages import Source
from mavlink_bridge.settings import (
    Contradiction,
    Document,
    StrictModel,
    assignments,
    load_yaml,
    merge,
    validate,
)
from mavlink_bridge.thrust import HOVER_MAX, HOVER_MIN

FILEVERSION = 1
_FENCE_REACH = 6.0  # m, more than the horizon's 2 s at any speed
DEFAULT, AIRFRAMES, BRIDGES = "default.yaml", "airframes", "bridges"


class AirframeConfig(StrictModel):
    """What differs from one kind of drone to another."""

    name: str = "quad5"
    radius: float = Field(
        0.2,
        gt=0,
        description="Of the sphere around the drone [m]; the distances that nmpc keeps are from "
        "its centre and must be larger.",
    )
    hover_thrust: float = Field(
        0.33, ge=HOVER_MIN, le=HOVER_MAX, description="Normalised thrust that holds it."
    )
    thrust_exponent: float = Field(
        1.0, ge=0.5, le=3, description="force ∝ thrust^exponent, as the autopilot is set up."
    )


def _well_formed(endpoint: str) -> str:
    parse_endpoint(endpoint)
    return endpoint


class SigningConfig(StrictModel):
    """MAVLink 2 signing: what is not signed with the key is not heard."""

    key: str = Field(
        description="File of 32 bytes or 64 hexadecimal digits that only the service can read; or "
        "the name of a systemd credential."
    )
    link_id: int = Field(0, ge=0, le=255, description="Of what the companion sends.")


class LinkConfig(StrictModel):
    """The MAVLink link to the autopilot."""

    endpoint: Annotated[str, AfterValidator(_well_formed)] = Field(
        "udpin:127.0.0.1:14541", description=ENDPOINT_FORMS
    )
    system_id: int = Field(1, ge=1, le=255, description="Of the vehicle.")
    component_id: int = Field(
        191, ge=2, le=255, description="Of the companion; 1 is the autopilot's."
    )
    autopilot: AutopilotName = "px4"
    allow: list[list[int]] = Field(
        [],
        description="[system, component] whose messages are heard, component 0: any; besides the "
        "vehicle's autopilot and another companion of it, who are always.",
    )
    signing: SigningConfig | None = Field(None, description="MAVLink 2 signing; none: unsigned.")

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        for n, pair in enumerate(self.allow):
            if len(pair) != 2 or not (1 <= pair[0] <= 255 and 0 <= pair[1] <= 255):
                raise Contradiction((f"allow.{n}",), f"must be [1…255, 0…255], got {pair}")
        return self

    def heard(self) -> list[Source]:
        """Everybody who is listened to."""
        mine = [Source(self.system_id, 1), Source(self.system_id, self.component_id)]
        return mine + [Source(*pair) for pair in self.allow]


class CameraConfig(StrictModel):
    """Where frames come from and how the lens images."""

    source: Annotated[str, AfterValidator(check_source)] = Field(
        "sim:127.0.0.1:15541", description=SOURCE_FORMS
    )
    latency: float = Field(
        0.03, ge=0, le=0.5, description="s from exposure to arrival, where a camera does not say."
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
    obstacles: Literal["camera", "depth", "map"] = "camera"
    detector: Literal["color", "cnn", "yolo"] = Field(
        "color",
        description="color: drones with a marker; cnn: the packaged network, drones as they are; "
        "yolo: a network of your own.",
    )
    model: str | None = Field(
        None, description="ONNX file, relative to this one: for yolo, or a cnn trained anew."
    )
    color: ColorSettings = ColorSettings()
    cnn: CnnConfig = CnnConfig()
    yolo: YoloConfig = YoloConfig()
    trunks: TrunkSettings = TrunkSettings()
    trunks_every: int = Field(
        2, ge=1, le=10, description="Frames from one look for trunks to the next: they stand still."
    )
    depth: DepthConfig = DepthConfig()


class TimingConfig(StrictModel):
    """When a tick falls due, and the delay that is made up for."""

    pace: Literal["clock", "frames"] = Field(
        "clock",
        description="clock: every period of the vehicle's clock; frames: when a frame comes "
        "(lockstep: the sender waits for the answer).",
    )
    period: float = Field(0.1, ge=0.02, le=0.2, description="s.")
    delay: float = Field(
        0.06, ge=0, le=0.5, description="From tick to effect [s]: compute, transport, rate loop."
    )


class FenceConfig(StrictModel):
    """Where the drone may be, own ENU frame [m]; planes of the NMPC."""

    altitude_min: float = Field(0.8, description="No plan leads below, once in flight.")
    altitude_max: float = Field(5.0, gt=1, description="Not above.")
    altitude_band: float = Field(
        1.0,
        gt=0,
        description="Around the goal's height: who evades up or down leaves the others' view.",
    )
    east: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most]; none where not given."
    )
    north: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most]; none where not given."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for key in ("east", "north"):
            limits = getattr(self, key)
            if limits is not None and limits[0] >= limits[1]:
                raise Contradiction((key,), f"must be [least, most], got {limits}")
        return self

    def planes(self) -> Vector:
        """(H,4) half-spaces n·p <= b: the sides, and the top last."""
        rows = []
        for axis, limits in enumerate((self.east, self.north)):
            for sign, limit in zip((-1.0, 1.0), limits or (), strict=False):
                row = [0.0, 0.0, 0.0, sign * limit]
                row[axis] = sign
                rows.append(row)
        return np.array([*rows, [0.0, 0.0, 1.0, self.altitude_max]])

    def sides(self) -> Vector:
        """(K,4) half-spaces n·p <= b, upright."""
        return self.planes()[:-1]

    def near(self, p: Vector, apart: float) -> Vector:
        """(K,4) the sides that a plan from p (3,) could reach, which keeps `apart` [m] from them.

        One that is crossed already only lets it go no farther. Sides and trunks share one slack:
        who were to come back at any price would come through a trunk.
        """
        sides = self.sides()
        beyond = sides[:, :3] @ p - sides[:, 3]
        sides[:, 3] += np.where(beyond > 0.0, beyond + apart, 0.0)
        near: Vector = sides[beyond > -_FENCE_REACH]
        return near

    def across(self, p: Vector, v: Vector) -> tuple[float, float]:
        """How far [m] p (3,) is outside (< 0: within), and how fast [m/s] v leads on outwards."""
        planes = self.planes()
        beyond = planes[:, :3] @ p - planes[:, 3]
        worst = int(np.argmax(beyond))
        return float(beyond[worst]), float(planes[worst, :3] @ v)


class BoardConfig(StrictModel):
    """The companion computer that the drone carries."""

    host: str | None = Field(
        None,
        pattern=r"^([a-z_][a-z0-9_-]*@)?[A-Za-z0-9][A-Za-z0-9.-]*$",
        description="USER@HOST where `companion deploy` finds it; drones without share one board.",
    )
    cpus: str | None = Field(
        None, pattern=r"^[0-9]+([-, ][0-9]+)*$", description="CPUs of the daemon, as `2-3`."
    )


class LogConfig(StrictModel):
    """The flight log."""

    path: str | None = Field(None, description="MCAP file; none where not given.")
    tlog: bool = Field(True, description="MAVLink traffic beside it, same name, as .tlog.")
    images: Literal["none", "periodic", "event"] = Field(
        "none", description="Camera pictures: one a second, or when phase, guard or goal changes."
    )


class CompanionConfig(StrictModel):
    """Everything that one daemon needs to know."""

    fileversion: Literal[1] = 1
    name: str = Field("drone1", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")
    airframe: AirframeConfig = AirframeConfig()
    link: LinkConfig = LinkConfig()
    camera: CameraConfig = CameraConfig()
    eye: EyeConfig = EyeConfig()
    sensing: SensingConfig = SensingConfig()
    timing: TimingConfig = TimingConfig()
    tracker: TrackerConfig = TrackerConfig()
    obstacles: ObstacleConfig = ObstacleConfig()
    surfaces: SurfaceConfig = SurfaceConfig()
    reciprocity: ReciprocityConfig = ReciprocityConfig()
    threat: ThreatConfig = ThreatConfig()
    gaze: GazeConfig = GazeConfig()
    mission: MissionConfig = MissionConfig()
    controller: Controller = Field(
        "nmpc", description="What plans: the NMPC, or a rule to compare it with; studies only."
    )
    nmpc: NmpcConfig = NmpcConfig()
    baselines: BaselinesConfig = BaselinesConfig()
    guard: GuardConfig = GuardConfig()
    fence: FenceConfig = FenceConfig()
    log: LogConfig = LogConfig()
    board: BoardConfig = BoardConfig()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for wrong in contradictions(self):
            raise wrong
        return self

    def altitude_planes(self, goal_altitude: float) -> Vector:
        """(2,4) half-spaces n·p <= b: the band around the goal's height, inside the fence."""
        top = min(self.fence.altitude_max, goal_altitude + self.fence.altitude_band)
        bottom = max(self.fence.altitude_min, goal_altitude - self.fence.altitude_band)
        return np.array([[0, 0, 1, top], [0, 0, -1, -bottom]], dtype=float)


def load_config(path: Path, overrides: list[str] | None = None) -> CompanionConfig:
    """Read a drone's file with its layers; `overrides` are path.to.key=value.

    Raises:
        SettingsError: with every mistake, as file:line:column: key: what.
    """
    return validate(CompanionConfig, resolve(path, overrides), str(path))


def resolve(path: Path, overrides: list[str] | None = None) -> Document:
    """The layers of a drone's file as one document, with the place of each value.

    Raises:
        SettingsError: a file that cannot be read at all; lesser mistakes wait in the document.
    """
    drone = _layer(path)
    layers = [] if is_layer(path) else [*_default(path), *_airframe(path, drone)]
    return merge([*layers, drone, assignments(overrides or [])])


def is_layer(path: Path) -> bool:
    """Whether a file is no drone but what lies below drones: default.yaml, airframes/*.yaml."""
    return path.name == DEFAULT or path.parent.name == AIRFRAMES


def is_bridge(path: Path) -> bool:
    """Whether a file configures a drone's `mavlink-bridge`: bridges/ beside the drones."""
    return path.parent.name == BRIDGES


def bridge_of(path: Path) -> Path:
    """Where the bridge of a drone's file is configured, if it has one: under the same name."""
    return path.parent / BRIDGES / path.name


def layers_of(path: Path) -> list[Path]:
    """The files that a drone's file builds on, lowest first; as far as they exist."""
    name = _airframe_name(load_yaml(path))
    files = [path.parent / DEFAULT, path.parent / AIRFRAMES / f"{name}.yaml"]
    return [] if is_layer(path) else [f for f in files if f.exists()]


def _layer(path: Path) -> Document:
    """One file, which must say for which version of this format it was written."""
    document = load_yaml(path)
    if "fileversion" not in document.data:
        document.problems.append(f"{path}:1:1: fileversion: is missing; valid: {FILEVERSION}")
    elif (found := document.data["fileversion"]) != FILEVERSION:
        place = document.places[("fileversion",)]
        document.problems.append(f"{place}: fileversion: must be {FILEVERSION}, got {found!r}")
        document.data["fileversion"] = FILEVERSION  # said once
    airframe = document.data.get("airframe")
    if isinstance(airframe, str):  # `airframe: quad5` is short for `airframe: {name: quad5}`
        document.data["airframe"] = {"name": airframe}
        document.places["airframe", "name"] = document.places[("airframe",)]
    for section, key in (("camera", "calibration"), ("sensing", "model")):
        part = document.data.get(section)
        if isinstance(part, dict) and isinstance(part.get(key), str):
            part[key] = str(path.parent / part[key])
    return document


def _default(path: Path) -> list[Document]:
    default = path.parent / DEFAULT
    return [_layer(default)] if default.exists() else []


def _airframe(path: Path, drone: Document) -> list[Document]:
    """The layer of the airframe that the drone names."""
    name = _airframe_name(drone)
    if name is None:
        return []
    folder = path.parent / AIRFRAMES
    file = folder / f"{name}.yaml"
    if file.exists():
        return [_layer(file)]
    known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml"))) or f"none in {folder}"
    place = drone.places["airframe", "name"]
    drone.problems.append(f"{place}: airframe.name: unknown airframe {name!r}; valid: {known}")
    return []


def _airframe_name(drone: Document) -> str | None:
    airframe: Any = drone.data.get("airframe")
    name = airframe.get("name") if isinstance(airframe, dict) else airframe
    return name if isinstance(name, str) else None
