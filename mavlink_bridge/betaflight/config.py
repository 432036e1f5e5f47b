"""Configuration of `mavlink-bridge betaflight`, one YAML file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from mavlink_bridge.shared.settings import StrictModel, assignments, load_yaml, merge, validate
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.link import parse_endpoint


def _endpoint(name: str) -> str:
    parse_endpoint(name)
    return name


def _stream(name: str) -> str:
    if parse_endpoint(name)[0] not in ("serial", "tcp"):
        raise ValueError("must be serial:DEVICE:BAUD or tcp:HOST:PORT")
    return name


Endpoint = Annotated[str, AfterValidator(_endpoint)]


class BridgeLinkConfig(StrictModel):
    """The MAVLink side."""

    endpoint: Endpoint = Field("udpout:127.0.0.1:14541", description="Where the companion listens.")
    ground: Endpoint | None = Field(
        "udpout:127.0.0.1:14550", description="Where a ground station listens; null: nowhere."
    )
    gps: Endpoint | None = Field(
        None,
        description="Where a receiver on the board sends GPS_INPUT, if the controller has none: "
        "udpin:HOST:PORT.",
    )
    system_id: int = Field(1, ge=1, le=255, description="MAVLink system id of the vehicle.")


class ThrottleConfig(StrictModel):
    """Relation of throttle and force."""

    hover: float = Field(0.5, gt=0, lt=1, description="Throttle in hover.")
    exponent: float = Field(1.75, ge=0.5, le=3, description="force ∝ throttle^exponent.")


class BridgeConfig(StrictModel):
    """Configuration of one bridge."""

    fileversion: Literal[1] = 1
    controller: Annotated[str, AfterValidator(_stream)] = Field(
        "serial:/dev/ttyACM0:115200",
        description="Betaflight's MSP port: serial:DEVICE:BAUD or tcp:HOST:PORT.",
    )
    link: BridgeLinkConfig = BridgeLinkConfig()
    throttle: ThrottleConfig = ThrottleConfig()
    angle_limit_deg: float = Field(60.0, gt=5, le=85, description="The controller's angle_limit.")
    setpoint_timeout: float = Field(
        0.2, ge=0.1, le=0.25, description="Silence [s] after which the sticks go level."
    )

    @property
    def thrust_map(self) -> ThrustMap:
        """Map from collective acceleration to throttle."""
        return ThrustMap(self.throttle.hover, self.throttle.exponent)

    @property
    def angle_limit(self) -> float:
        """Tilt at full stick in ANGLE mode [rad]."""
        return math.radians(self.angle_limit_deg)


def load_bridge_config(path: Path, overrides: list[str] | None = None) -> BridgeConfig:
    """Load a bridge's file; overrides: `path.to.key=value` each.

    Raises:
        SettingsError: lists every mistake as file:line:column: key: mistake.
    """
    document = merge([load_yaml(path), assignments(overrides or [])])
    return validate(BridgeConfig, document, str(path))
