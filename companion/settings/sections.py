"""The sections of one drone's configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from companion.control.baselines import CONTROLLERS
from companion.control.baselines.config import BaselinesConfig
from companion.control.nmpc import NmpcConfig
from companion.estimation.obstacle_map import ObstacleConfig
from companion.estimation.surface_map import SurfaceConfig
from companion.estimation.tracker_config import TrackerConfig
from companion.guidance.fence import FenceConfig
from companion.guidance.gaze import GazeConfig
from companion.guidance.mission import MissionConfig
from companion.guidance.right_of_way import RightOfWayConfig
from companion.guidance.speed_limits import SpeedLimitConfig
from companion.guidance.threat import ThreatConfig
from companion.perception.camera_health import CameraHealthConfig
from companion.perception.config import CameraConfig, SensingConfig
from companion.settings.renamed import REMOVED, RENAMED
from companion.supervision.certify import CertificateConfig
from companion.supervision.guard_config import GuardConfig
from companion.supervision.monitors import MonitorConfig
from mavlink_bridge.autopilots.registry import AutopilotName
from mavlink_bridge.shared.settings import (
    Contradiction,
    StrictModel,
)
from mavlink_bridge.shared.thrust import HOVER_MAX, HOVER_MIN
from mavlink_bridge.wire.link import ENDPOINT_FORMS, parse_endpoint
from mavlink_bridge.wire.messages import Source


class AirframeConfig(StrictModel):
    """The body and the thrust of one kind of drone."""

    name: str = Field("quad5", description="Name of a file in airframes/.")
    radius: float = Field(
        0.2,
        gt=0,
        description="Radius of the sphere around the drone [m]; nmpc's distances count from its "
        "centre and must be larger.",
    )
    hover_thrust: float = Field(
        0.33,
        ge=HOVER_MIN,
        le=HOVER_MAX,
        description="Normalised thrust 0…1 that holds the drone in hover; learnt in flight.",
    )
    hover_doubt: float = Field(
        0.3,
        ge=0.01,
        le=1,
        description="Doubt of hover_thrust, one sigma, as a share of it. Above 0.05 the companion "
        "takes over only after the vehicle's ATTITUDE_TARGET has told it more.",
    )
    drag: float = Field(
        0.0,
        ge=0,
        le=2,
        description="Deceleration along the ground by the air, per speed [1/s]; 0: what drag there "
        "is counts as wind.",
    )
    thrust_exponent: float | None = Field(
        None,
        ge=0.5,
        le=3,
        description="Exponent of force ∝ thrust^exponent near hover; null: by the autopilot's "
        "parameter (THR_MDL_FAC, MOT_THST_EXPO), 1 where it has none.",
    )

    @property
    def exponent(self) -> float:
        """The exponent of force ∝ thrust^exponent, until the autopilot tells it."""
        return 1.0 if self.thrust_exponent is None else self.thrust_exponent


def _well_formed(endpoint: str) -> str:
    parse_endpoint(endpoint)
    return endpoint


class SigningConfig(StrictModel):
    """MAVLink 2 signing: messages that are not signed with the key are refused."""

    key: str = Field(
        description="Key file that only the service can read (32 bytes or 64 hexadecimal digits), "
        "or the name of a systemd credential."
    )
    link_id: int = Field(0, ge=0, le=255, description="Link id of the companion's messages.")


class LinkConfig(StrictModel):
    """The MAVLink link to the autopilot."""

    endpoint: Annotated[str, AfterValidator(_well_formed)] = Field(
        "udpin:127.0.0.1:14541", description=ENDPOINT_FORMS
    )
    system_id: int = Field(1, ge=1, le=255, description="System id of the vehicle.")
    component_id: int = Field(
        191, ge=2, le=255, description="Component id of the companion; 1 is the autopilot."
    )
    autopilot: AutopilotName = Field("px4", description="Firmware of the vehicle.")
    allow: list[list[int]] = Field(
        [],
        description="Further [system, component] whose messages are read, component 0: any. Those "
        "of the vehicle's autopilot and of another companion always are.",
    )
    signing: SigningConfig | None = Field(None, description="MAVLink 2 signing; null: unsigned.")

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        for n, pair in enumerate(self.allow):
            if len(pair) != 2 or not (1 <= pair[0] <= 255 and 0 <= pair[1] <= 255):
                raise Contradiction((f"allow.{n}",), f"must be [1…255, 0…255], got {pair}")
        return self

    def heard(self) -> list[Source]:
        """Return the sources whose messages are read."""
        mine = [Source(self.system_id, 1), Source(self.system_id, self.component_id)]
        return mine + [Source(*pair) for pair in self.allow]


class TimingConfig(StrictModel):
    """When a tick falls due, and the delay that the prediction covers."""

    pace: Literal["clock", "frames"] = Field(
        "clock",
        description="clock: a tick every period of the vehicle's clock; frames: a tick per frame "
        "(lockstep: the sender waits for the answer).",
    )
    period: float = Field(0.1, ge=0.02, le=0.2, description="Time between ticks [s].")
    delay: float = Field(
        0.06,
        ge=0,
        le=0.5,
        description="Delay [s] from a tick to its effect in telemetry: compute, transport, rate "
        "loop. It is measured in flight; the measurement starts from here.",
    )


class BoardConfig(StrictModel):
    """The companion computer that the drone carries."""

    host: str | None = Field(
        None,
        pattern=r"^([a-z_][a-z0-9_-]*@)?[A-Za-z0-9][A-Za-z0-9.-]*$",
        description="USER@HOST for `companion deploy`; drones without a host share one board.",
    )
    cpus: str | None = Field(
        None,
        pattern=r"^[0-9]+([-, ][0-9]+)*$",
        description="CPUs that the daemon is pinned to, as `2-3`.",
    )


class LogConfig(StrictModel):
    """The flight log."""

    path: str | None = Field(None, description="MCAP file; null: no log.")
    tlog: bool = Field(
        True, description="Whether to write the MAVLink traffic beside it, as .tlog."
    )
    corners: bool = Field(
        False,
        description="Corners followed from picture to picture, for `companion calibrate`; always "
        "with mission.commission.",
    )
    images: Literal["none", "periodic", "event"] = Field(
        "none", description="Camera pictures: one per second, or when phase, guard or goal changes."
    )


class CompanionSections(StrictModel):
    """The sections of a drone's file, each valid by itself."""

    RENAMED: ClassVar[Mapping[str, str]] = RENAMED
    REMOVED: ClassVar[Mapping[str, str]] = REMOVED

    fileversion: Literal[2] = 2
    name: str = Field(
        "drone1",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$",
        description="Name of the drone, unique in the swarm.",
    )
    airframe: AirframeConfig = AirframeConfig()
    link: LinkConfig = LinkConfig()
    camera: CameraConfig = CameraConfig()
    camera_health: CameraHealthConfig = CameraHealthConfig()
    sensing: SensingConfig = SensingConfig()
    timing: TimingConfig = TimingConfig()
    tracker: TrackerConfig = TrackerConfig()
    obstacles: ObstacleConfig = ObstacleConfig()
    surfaces: SurfaceConfig = SurfaceConfig()
    threat: ThreatConfig = ThreatConfig()
    right_of_way: RightOfWayConfig = RightOfWayConfig()
    speed_limits: SpeedLimitConfig = SpeedLimitConfig()
    gaze: GazeConfig = GazeConfig()
    mission: MissionConfig = MissionConfig()
    controller: Annotated[str, AfterValidator(CONTROLLERS.check)] = Field(
        "nmpc",
        description="The planner: nmpc; to compare with, single-horizon, reynolds, vasarhelyi, "
        "potential-field, orca, rbl or avocado; your own by the name of its entry point, or "
        "module:Class.",
    )
    controller_options: dict[str, Any] = Field({}, description="Passed to your own controller.")
    nmpc: NmpcConfig = NmpcConfig()
    baselines: BaselinesConfig = BaselinesConfig()
    guard: GuardConfig = GuardConfig()
    monitors: MonitorConfig = MonitorConfig()
    certificate: CertificateConfig = CertificateConfig()
    fence: FenceConfig = FenceConfig()
    log: LogConfig = LogConfig()
    board: BoardConfig = BoardConfig()
