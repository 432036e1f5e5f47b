"""Guidance of a drone 2 m up at the origin, tick by tick, as the pipeline drives it."""

from dataclasses import replace

import numpy as np

from companion.estimation.delay import Delay
from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.guidance import Guidance
from companion.perception.camera_health import CameraFault
from companion.settings.config import CompanionConfig
from companion.types import Phase
from mavlink_bridge.shared.frames import quaternion_from_euler
from tests.companion.depth_images import state

HERE = [0.0, 0.0, 2.0]
SOON = Delay(0.06, 0.003)  # no limit
STEADY = {"survey": 0.0, "sigma": 0.0}  # looks along the way at once
AHEAD = [9.0, 0.0, 2.0]


def guiding(*goals, **sections):
    """Guidance on a mission to `goals`, without a look round or a sweep unless asked for."""
    data = {"gaze": STEADY, "log": {"path": "flight.mcap"}, **sections}
    data["mission"] = {"goals": list(goals), **sections.get("mission", {})}
    return Guidance(CompanionConfig.model_validate(data).guidance())


def own(p=HERE, yaw=0.0, v=(0.0, 0.0, 0.0), time=0.0):
    level = state(p, quaternion_from_euler(0.0, 0.0, yaw), time)
    return replace(level, v=np.array(v, float))


def decided(guidance, at=None, tracks=(), trunks=(), points=(), **more):
    """The reference of one tick."""
    known = KnownObstacles(
        np.reshape(np.array(trunks, float), (-1, 3)),
        np.reshape(np.array(points, float), (-1, 3)),
        sigmas=np.full(len(trunks), 0.1),
    )
    inputs = {"fault": CameraFault.NONE, "phase": Phase.FLY, "delay": SOON, **more}
    return guidance.decide(own() if at is None else at, list(tracks), known, **inputs)


def wall(open_from, open_to):
    """Points 0.1 m apart of a wall 3 m ahead, from 4 m right to 4 m left, with an opening."""
    across = np.arange(-4.0, 4.0, 0.1)
    closed = across[(across < open_from) | (across > open_to)]
    return [[3.0, y, z] for y in closed for z in np.arange(1.0, 3.0, 0.1)]
