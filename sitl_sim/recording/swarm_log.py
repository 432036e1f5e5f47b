"""One log of the whole swarm: all drones' topics, one tree of frames, the truth; MCAP.

| topic | holds |
|---|---|
| `/NAME/…` | every topic of that drone's log, at the time since the flight began |
| `/truth/tf`, `/truth/NAME/pose` | where each drone truly was: frame `NAME/true` in `world` |
| `/truth/scene`, `/truth/obstacles` | the obstacles of the world: shapes, and as points |
| `/truth/NAME/camera`, `/NAME/annotations` | pictures, and what the companion found in them |

Frames: `world` → `NAME/map` (the drone's own frame) → `NAME` (where it believes to be). Bodies of
`/tick` and `/inputs` are as in the drone's log: by its own clock, in its own frame.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from mavlink_bridge.shared.mcap_file import check_whole
from sitl_sim.recording.camera_topics import write_cameras
from sitl_sim.recording.run_folder import OwnFrame, Run, log_path, own_frames
from sitl_sim.scenarios import scenario as scenarios

WORLD = "world"
_NANO = 1_000_000_000
_TRUTH_EVERY = 5  # samples of the truth: 10 Hz
_TALL = 20.0  # m, of a trunk without a height
_CLASSES: dict[str, type[Message]] = {
    c.DESCRIPTOR.full_name: c
    for c in (PoseInFrame, FrameTransform, SceneUpdate, Log, CompressedImage)
}


def write_swarm_log(run: Run, path: Path) -> Path:
    """Write the log of all drones of a flight; return its path.

    Raises:
        LogError: a drone's log is missing or cut off.
    """
    frames = dict(zip(run.names, own_frames(run.scenario, run.world), strict=True))
    flown = scenarios.companion_names(run.scenario)
    for name in flown:
        check_whole(log_path(run.folder, name))
    unfinished = path.with_name(f"{path.name}.part")
    with unfinished.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library=f"swarm-companion {version('swarm-companion')}")
        writer.add_metadata("flight", _about(run))
        truth = _Truth(writer, run)
        truth.write(frames)
        write_cameras(truth.put, run, frames)
        for name, frame in frames.items():
            if name not in flown:
                continue
            _copy(writer, log_path(run.folder, name), name, frame)
        writer.finish()  # type: ignore[no-untyped-call]
    unfinished.rename(path)
    return path


def _about(run: Run) -> dict[str, str]:
    """Return version, commit, scenario, seed, and the wall clock when the flight began."""
    began = (run.folder / "scenario.yaml").stat().st_mtime  # written just before
    when = datetime.datetime.fromtimestamp(began, datetime.UTC)
    return {
        "version": version("swarm-companion"),
        "commit": str(run.metrics.get("commit") or "unknown"),
        "scenario": run.scenario.name,
        "seed": str(run.scenario.seed),
        "began": when.isoformat(timespec="seconds"),
        "time": "since the flight began; add `began` for the wall clock",
    }


def _copy(writer: Writer, path: Path, name: str, frame: OwnFrame) -> None:
    """Copy a drone's log under its name, at the time since the flight began."""
    channels: dict[int, int] = {}
    shift = round(frame.boot * _NANO)
    with path.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            if channel.id not in channels:
                number = 0 if schema is None else _register(writer, schema)
                channels[channel.id] = writer.register_channel(
                    f"/{name}{channel.topic}", channel.message_encoding, number
                )
            time = max(message.log_time - shift, 0)
            kind = None if schema is None else _CLASSES.get(schema.name)
            data = message.data if kind is None else _placed(kind, message.data, name, shift)
            writer.add_message(channels[channel.id], time, data, time, message.sequence)
        for record in reader.iter_metadata():
            writer.add_metadata(f"{name}/{record.name}", record.metadata)


def _register(writer: Writer, schema: Any) -> int:
    number: int = writer.register_schema(schema.name, schema.encoding, schema.data)
    return number


def _placed(kind: type[Message], data: bytes, name: str, shift: int) -> bytes:
    """Return a message in the frames and at the time of the swarm's log.

    shift: ns that the drone's clock is ahead.
    """
    message: Any = kind.FromString(data)
    for part in _stamped(message):
        own = part.timestamp.seconds * _NANO + part.timestamp.nanos
        now = max(own - shift, 0)
        part.timestamp.seconds, part.timestamp.nanos = divmod(now, _NANO)
        for key in ("frame_id", "parent_frame_id"):
            if getattr(part, key, None) == WORLD:
                setattr(part, key, f"{name}/map")
    placed: bytes = message.SerializeToString()
    return placed


def _stamped(message: Any) -> list[Any]:
    """Return the parts of a message that have a time: its entities, else the message itself."""
    if isinstance(message, SceneUpdate):
        return list(message.entities)
    if isinstance(message, ImageAnnotations):
        return [message, *message.circles, *message.texts]
    return [message]


class _Truth:
    """Writes what the simulator knows."""

    def __init__(self, writer: Writer, run: Run) -> None:
        self._writer = writer
        self._run = run
        self._channels: dict[str, int] = {}

    def write(self, frames: dict[str, OwnFrame]) -> None:
        """Write own frames, obstacles and true poses."""
        for name, frame in frames.items():
            turn = [np.cos(frame.yaw / 2), 0.0, 0.0, np.sin(frame.yaw / 2)]
            self.put("/truth/tf", 0.0, _transform(f"{name}/map", frame.origin, turn))
        self.put("/truth/scene", 0.0, _obstacles(self._run.world))
        self.put("/truth/obstacles", 0.0, _cloud(self._run.world))
        truth = self._run.truth
        for k in range(0, len(truth["t"]), _TRUTH_EVERY):
            t = float(truth["t"][k])
            for i, name in enumerate(self._run.names):
                p, q = truth["position"][k, i], truth["attitude"][k, i]
                transform = _transform(f"{name}/true", p, q)
                self.put("/truth/tf", t, transform)
                pose = PoseInFrame(frame_id=WORLD)
                pose.pose.position.CopyFrom(_point(p))
                pose.pose.orientation.CopyFrom(transform.rotation)
                self.put(f"/truth/{name}/pose", t, pose)

    def put(self, topic: str, t: float, message: Any) -> None:
        """Write a message at a time [s] since the flight began."""
        kind = type(message)
        if topic not in self._channels:
            types = build_file_descriptor_set(kind).SerializeToString()
            schema = self._writer.register_schema(kind.DESCRIPTOR.full_name, "protobuf", types)
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema)
        time = round(t * _NANO)
        for part in _stamped(message):
            part.timestamp.seconds, part.timestamp.nanos = divmod(time, _NANO)
        self._writer.add_message(self._channels[topic], time, message.SerializeToString(), time)


def _transform(child: str, p: Any, q: Any) -> FrameTransform:
    made = FrameTransform(parent_frame_id=WORLD, child_frame_id=child)
    made.translation.x, made.translation.y, made.translation.z = map(float, p)
    o = made.rotation
    o.w, o.x, o.y, o.z = map(float, q)
    return made


def _point(p: Any) -> Any:
    made = PoseInFrame().pose.position
    made.x, made.y, made.z = map(float, p)
    return made


def _obstacles(world: dict[str, Any]) -> SceneUpdate:
    """Return cylinders and boxes of a world as one entity."""
    scene = SceneUpdate()
    entity = scene.entities.add(id="obstacles", frame_id=WORLD)
    for shape, size, middle in _shapes(world):
        solid = getattr(entity, shape).add()
        solid.pose.position.CopyFrom(_point(middle))
        solid.pose.orientation.w = 1.0
        solid.size.x, solid.size.y, solid.size.z = size
        c = solid.color
        c.r, c.g, c.b, c.a = 0.5, 0.4, 0.3, 0.8
        if shape == "cylinders":
            solid.bottom_scale = solid.top_scale = 1.0
    return scene


def _cloud(world: dict[str, Any]) -> PointCloud:
    """Return points on the obstacles' surfaces, for viewers that do not draw shapes."""
    x, y = np.meshgrid(np.arange(-1, 1.01, 0.1), np.arange(-1, 1.01, 0.1))
    face = np.stack([x.ravel(), y.ravel()], axis=1) / 2
    angle, height = (a.ravel() for a in np.meshgrid(np.arange(0, 2 * np.pi, 0.2), np.arange(21)))
    rim = np.stack([np.cos(angle) / 2, np.sin(angle) / 2, height / 20 - 0.5], axis=1)
    sides = [np.insert(face, axis, side, axis=1) for axis in range(3) for side in (-0.5, 0.5)]
    unit = {"cylinders": rim, "cubes": np.vstack(sides)}
    parts = [unit[shape] * size + middle for shape, size, middle in _shapes(world)]
    points = np.concatenate([*parts, np.zeros((0, 3))]).astype("<f4")
    cloud = PointCloud(frame_id=WORLD, point_stride=12, data=points.tobytes())
    cloud.pose.position.SetInParent()  # viewers read a position left out as missing, not as zero
    cloud.pose.orientation.w = 1.0
    for n, name in enumerate("xyz"):
        cloud.fields.add(name=name, offset=4 * n, type=PackedElementField.FLOAT32)
    return cloud


def _shapes(world: dict[str, Any]) -> Iterator[tuple[str, list[float], list[float]]]:
    """Yield kind, size [m] and middle [m] of each cylinder and box."""
    for c in world["cylinders"]:
        height = min(float(c["height"]), _TALL)
        yield "cylinders", [2 * c["radius"]] * 2 + [height], [c["x"], c["y"], height / 2]
    for b in world["boxes"]:
        low, high = np.array(b["min"]), np.array(b["max"])
        yield "cubes", (high - low).tolist(), ((low + high) / 2).tolist()
