"""A tick as Foxglove messages, for any viewer of MCAP: pose, plan, tracks, threats, obstacles.

The scene has one entity each for the plan (line), the tracks (spheres with velocity), the critical
neighbours (lines to them, with their threat) and the obstacles (cylinders). A new entity replaces
the one of the same id.
"""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import ArrayLike

from companion.tick import Tick
from companion.types import Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState

_DRONE_SIZE = 0.4  # m
_HEIGHT = 5.0  # m, as an obstacle is drawn
_BLUE, _RED, _GREY, _BROWN = (
    Color(r=0.1, g=0.4, b=1.0, a=1.0),
    Color(r=0.9, g=0.1, b=0.1, a=1.0),
    Color(r=0.5, g=0.5, b=0.5, a=0.8),
    Color(r=0.5, g=0.4, b=0.3, a=0.6),
)
_SPHERE = Vector3(x=_DRONE_SIZE, y=_DRONE_SIZE, z=_DRONE_SIZE)
_STRIP, _LIST = 0, 2  # LinePrimitive.Type LINE_STRIP, LINE_LIST


def stamp(time: float) -> Timestamp:
    """Return a time [s, vehicle's clock] as Foxglove's."""
    return Timestamp(seconds=int(time), nanos=round(time % 1.0 * 1e9))


def pose(own: VehicleState) -> PoseInFrame:
    """Return the own pose in the drone's ENU frame."""
    return PoseInFrame(timestamp=stamp(own.time), frame_id="world", pose=_pose(own.p, own.q_wb))


def transform(own: VehicleState, name: str) -> FrameTransform:
    """Return the body frame, under the drone's name, in the drone's ENU frame."""
    p = _pose(own.p, own.q_wb)
    return FrameTransform(
        timestamp=stamp(own.time),
        parent_frame_id="world",
        child_frame_id=name,
        translation=p.position,
        rotation=p.orientation,
    )


def event(time: float, name: str, text: str) -> Log:
    """Return a log message."""
    return Log(timestamp=stamp(time), level=Log.INFO, name=name, message=text)


def scene(tick: Tick, obstacles: bool) -> SceneUpdate:
    """Return plan, tracks and critical neighbours of a tick; obstacles: whether those, too."""
    made, when = SceneUpdate(), stamp(tick.time)

    def entity(name: str) -> SceneEntity:
        return made.entities.add(id=name, timestamp=when, frame_id="world")

    _tracks(entity("tracks"), tick.tracks)
    if tick.vehicle.state is not None and tick.reference is not None:
        _critical(entity("critical"), tick.vehicle.state, tick.reference.critical)
    if tick.planned.plan is not None:
        _plan(entity("plan"), tick.planned.plan.x[:, :3])
    if obstacles:
        _obstacles(entity("obstacles"), tick.obstacles.cylinders)
    return made


def _pose(p: Vector, q: Vector) -> Pose:
    made = Pose()
    made.position.x, made.position.y, made.position.z = p.tolist()
    o = made.orientation
    o.w, o.x, o.y, o.z = q.tolist()
    return made


def _points(rows: ArrayLike) -> list[Point3]:
    """Return rows (n,3) as points, in single precision: half the size."""
    single = np.asarray(rows, dtype=np.float32)
    return [Point3(x=x, y=y, z=z) for x, y, z in single.tolist()]


def _plan(entity: SceneEntity, path: Vector) -> None:
    line = entity.lines.add(type=_STRIP, thickness=0.04, color=_BLUE)
    line.points.extend(_points(path))


def _tracks(entity: SceneEntity, tracks: list[Track]) -> None:
    if not tracks:
        return
    velocity = entity.lines.add(type=_LIST, thickness=0.03, color=_GREY)
    velocity.points.extend(_points([end for t in tracks for end in (t.p, t.p + t.v)]))
    for at in velocity.points[::2]:
        sphere = entity.spheres.add(color=_GREY, size=_SPHERE)
        position = sphere.pose.position
        position.x, position.y, position.z = at.x, at.y, at.z


def _critical(entity: SceneEntity, own: VehicleState, critical: list[tuple[Track, float]]) -> None:
    if not critical:
        return
    edges = entity.lines.add(type=_LIST, thickness=0.03, color=_RED)
    edges.points.extend(_points([end for t, _ in critical for end in (own.p, t.p)]))
    for (track, threat), there in zip(critical, edges.points[1::2], strict=True):
        label = entity.texts.add(
            text=f"{track.id}: {threat:.2f}", font_size=0.2, color=_RED, billboard=True
        )
        position = label.pose.position
        position.x, position.y, position.z = there.x, there.y, there.z + 0.3


def _obstacles(entity: SceneEntity, cylinders: Vector) -> None:
    for x, y, radius in cylinders.round(3).tolist():
        c = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0, color=_BROWN)
        c.pose.position.x, c.pose.position.y, c.pose.position.z = x, y, _HEIGHT / 2
        c.size.x = c.size.y = 2 * radius
        c.size.z = _HEIGHT
