"""The sections of one drone's configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from companion.control.baselines.config import BaselinesConfig, Controller
from companion.control.nmpc import NmpcConfig
from companion.estimation.obstacle_map import ObstacleConfig
from companion.estimation.surface_map import SurfaceConfig
from companion.estimation.tracker import TrackerConfig
from companion.guidance.fence import FenceConfig
from companion.guidance.gaze import GazeConfig
from companion.guidance.mission import MissionConfig
from companion.guidance.reciprocity import ReciprocityConfig
from companion.guidance.right_of_way import RightOfWayConfig
from companion.guidance.speed_limits import SpeedLimitConfig
from companion.guidance.threat import ThreatConfig
from companion.perception.camera_health import CameraHealthConfig
from companion.perception.config import CameraConfig, SensingConfig
from companion.settings.renamed import RENAMED
from companion.supervision.guard import GuardConfig
from mavlink_bridge.autopilots.registry import AutopilotName
from mavlink_bridge.shared.settings import (
    Contradiction,
    StrictModel,
)
from mavlink_bridge.shared.thrust import HOVER_MAX, HOVER_MIN
from mavlink_bridge.wire.link import ENDPOINT_FORMS, parse_endpoint
from mavlink_bridge.wire.messages import Source


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


class CompanionSections(StrictModel):
    """The sections of a drone's file, each valid by itself."""

    RENAMED: ClassVar[Mapping[str, str]] = RENAMED

    fileversion: Literal[2] = 2
    name: str = Field("drone1", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")
    airframe: AirframeConfig = AirframeConfig()
    link: LinkConfig = LinkConfig()
    camera: CameraConfig = CameraConfig()
    camera_health: CameraHealthConfig = CameraHealthConfig()
    sensing: SensingConfig = SensingConfig()
    timing: TimingConfig = TimingConfig()
    tracker: TrackerConfig = TrackerConfig()
    obstacles: ObstacleConfig = ObstacleConfig()
    surfaces: SurfaceConfig = SurfaceConfig()
    reciprocity: ReciprocityConfig = ReciprocityConfig()
    threat: ThreatConfig = ThreatConfig()
    right_of_way: RightOfWayConfig = RightOfWayConfig()
    speed_limits: SpeedLimitConfig = SpeedLimitConfig()
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
