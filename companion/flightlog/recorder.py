"""The flight log: one MCAP file, and the MAVLink traffic beside it as a .tlog.

| topic | message |
|---|---|
| `/tick` | JSON: the results of all stages of the tick (`record.py`) |
| `/inputs` | the exact inputs of the tick, from which a replay starts (`inputs.py`) |
| `/corners` | corners followed from picture to picture, where wanted (`corners.py`) |
| `/pose` `/tf` `/scene` `/events` `/image` | Foxglove's types, for any viewer (`foxglove.py`) |

Chunks end every half second, so that a kill in flight loses less than that; one of a drone that
waits loses up to ten seconds (`idle.py`). A tick is recorded after its messages were sent. A log
with `{time}` in its name never replaces an older one: boards without a battery-backed clock start
at the same second every day.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set
from orjson import dumps

from companion.flightlog import corners as pairs
from companion.flightlog import foxglove as scene
from companion.flightlog import inputs as recorded
from companion.flightlog import record as records
from companion.flightlog.idle import IdleTicks
from companion.flightlog.mcap_writer import McapWriter
from companion.flightlog.tlog import TelemetryLog
from companion.perception.camera_health import CameraFault
from companion.perception.corner_pairs import CornerFollower
from companion.perception.view import load_camera
from companion.settings.config import CompanionConfig
from companion.tick import Tick, TickInputs
from companion.types import Image, Phase
from mavlink_bridge.wire.video import Frame

Packets = Sequence[tuple[bool, bytes]]  # (sent by us, datagram)
_Entry = tuple[int, int, bytes, int]  # channel, time [ns], message, number of the tick
CONFIG = "config"  # name of the metadata record of the drone's configuration
_CHUNK = 256 * 1000  # bytes, most that one chunk holds
_TICKS_A_CHUNK = 5
_TICKS_A_SCENE = 2  # for viewers; /tick has all ticks
_TICKS_A_MAP = 10  # obstacles change slowly, and viewers keep them
_IMAGE_PERIOD = 1.0  # s
_PROTOBUF: dict[str, type[Message]] = {
    "/pose": PoseInFrame,
    "/tf": FrameTransform,
    "/scene": SceneUpdate,
    "/events": Log,
    "/image": CompressedImage,
}


class Recorder:
    """Writes the log of one drone; a disk error ends the log, never the flight.

    path: the log's file. failed: why the log ended early; None: it goes on.

    Raises:
        OSError: the file cannot be made.
    """

    def __init__(self, config: CompanionConfig, path: Path) -> None:
        self.failed: str | None = None
        self._name = config.name
        self._images = config.log.images
        self._file = _create(path) if "{time}" in (config.log.path or "") else path.open("wb")
        self.path = Path(self._file.name)
        self._tlog = TelemetryLog(self.path.with_suffix(".tlog")) if config.log.tlog else None
        self._writer = McapWriter(self._file, self.path.parent, _CHUNK)
        self._writer.add_metadata(CONFIG, _configuration(config))
        self._follower: CornerFollower | None = None
        if config.log.corners or config.mission.commission:
            self._follower = CornerFollower(config.camera.width, config.camera.height)
            self._shape = (config.camera.height, config.camera.width, 3)
            unturned = config.camera.model_copy(update={"mount_deg": [0.0, 0.0, 0.0]})
            lens = dumps(load_camera(unturned).as_data()).decode()
            self._writer.add_metadata(pairs.CAMERA, {"calibration": lens})
        self._channels = self._register()
        self._file.flush()
        self._count = 0
        self._state: dict[str, str] = {}
        self._image_time = -np.inf
        self._idle: IdleTicks[_Entry] = IdleTicks()
        self._entries: list[_Entry] = []  # of the tick under way

    def write(
        self,
        inputs: TickInputs,
        tick: Tick,
        packets: Packets,
        counters: dict[str, Any],
        costs: dict[str, float],
    ) -> None:
        """Append a tick.

        packets: since the tick before, in order. counters: of link and deadlines, so far. costs: s,
        of work that is no stage of the tick.
        """
        if self.failed is not None:
            return
        try:
            self._write_inputs(inputs, tick, packets)
            self._write_tick(inputs, tick, counters, costs)
            self._end_tick(tick, packets)
        except OSError as error:
            self.failed = f"flight log ended: {error}"

    def close(self) -> None:
        """Write the index, without which readers refuse the file, and close it."""
        try:
            if self.failed is None:
                self._append(self._idle.rest())
                self._writer.finish()
            if self._tlog is not None:
                self._tlog.close()
            self._writer.close()
            self._file.close()
        except OSError as error:
            self.failed = f"flight log ended: {error}"

    def _register(self) -> dict[str, int]:
        tick = self._writer.register_schema("Tick", "jsonschema", dumps(records.SCHEMA))
        tags = {"drone": self._name}
        channels = {
            "/tick": self._writer.register_channel("/tick", "json", tick, tags),
            "/inputs": self._writer.register_channel("/inputs", "swarm-inputs", 0, tags),
        }
        if self._follower is not None:
            channels[pairs.TOPIC] = self._writer.register_channel(
                pairs.TOPIC, "swarm-corners", 0, tags
            )
        for topic, kind in _PROTOBUF.items():
            types = build_file_descriptor_set(kind).SerializeToString()
            schema = self._writer.register_schema(kind.DESCRIPTOR.full_name, "protobuf", types)
            channels[topic] = self._writer.register_channel(topic, "protobuf", schema, tags)
        return channels

    def _write_inputs(self, inputs: TickInputs, tick: Tick, packets: Packets) -> None:
        # A replay has no pictures to find their lag by.
        stamp, lag = tick.seen.stamp, tick.seen.alignment.lag
        frame_time = None if stamp is None else stamp - lag
        came = [data for sent, data in packets if not sent]
        shown = tick.seen.fault in (CameraFault.NONE, CameraFault.LATE)
        data = recorded.encode(
            tick.time, came, frame_time, tick.seen, inputs.leave, shown, inputs.latest, lag
        )
        self._add("/inputs", tick.time, data)

    def _write_tick(
        self, inputs: TickInputs, tick: Tick, counters: dict[str, Any], costs: dict[str, float]
    ) -> None:
        self._add("/tick", tick.time, records.encode(tick, counters, costs, inputs.clock))
        own = tick.vehicle.state
        if own is not None:
            self._put("/pose", tick.time, scene.pose(own))
            self._put("/tf", tick.time, scene.transform(own, self._name))
        if self._count % _TICKS_A_SCENE == 0:
            obstacles = self._count % _TICKS_A_MAP == 0
            self._put("/scene", tick.time, scene.scene(tick, obstacles))
        changed = self._write_events(tick)
        self._write_corners(inputs.frame, tick)
        if inputs.frame is not None and self._wants_image(tick.time, changed):
            self._write_image(inputs.frame)

    def _end_tick(self, tick: Tick, packets: Packets) -> None:
        entries, self._entries = self._entries, []
        self._append(self._idle.due(tick, entries))
        if self._tlog is not None:
            heartbeat = tick.vehicle.heartbeat
            armed = heartbeat is None or heartbeat.armed
            self._tlog.write(tick.time, packets, armed, self._idle.asleep)
        self._count += 1
        if self._count % _TICKS_A_CHUNK == 0:
            self._writer.flush()
            if os.fstat(self._file.fileno()).st_nlink == 0:
                # Writing would go on without an error, to where nobody can read it.
                raise FileNotFoundError(f"{self.path} was removed")
            if self._tlog is not None:
                self._tlog.flush()

    def _put(self, topic: str, time: float, message: Message) -> None:
        self._add(topic, time, message.SerializeToString())

    def _add(self, topic: str, time: float, data: bytes) -> None:
        self._entries.append((self._channels[topic], round(time * 1e9), data, self._count))

    def _append(self, entries: Iterable[_Entry]) -> None:
        for entry in entries:
            self._writer.add_message(*entry)

    def _write_events(self, tick: Tick) -> bool:
        """Log each change of phase, guard reason or goal; return whether there was any."""
        state = {"phase": tick.supervised.phase.value}
        if tick.supervised.verdict is not None:
            state["guard"] = tick.supervised.verdict.reason.value
        if tick.reference is not None:
            state["goal"] = str(tick.reference.progress.index)
        changed = [(k, v) for k, v in state.items() if self._state.get(k) != v]
        for key, value in changed:
            text = f"{key}: {self._state.get(key, '-')} -> {value}"
            self._put("/events", tick.time, scene.event(tick.time, self._name, text))
        self._state |= state
        return bool(changed)

    def _write_corners(self, frame: Frame | None, tick: Tick) -> None:
        """Log where the corners of the last picture are now, while the companion flies."""
        image: Image | None = None if frame is None else frame.arrays.get("image")
        if self._follower is None or frame is None or image is None:
            return
        if tick.supervised.phase is Phase.FLY and image.shape == self._shape:
            found = self._follower.update(frame.time, image)
            if found is not None:
                self._add(pairs.TOPIC, tick.time, pairs.encode(found))

    def _wants_image(self, time: float, changed: bool) -> bool:
        if self._images == "none" or (self._images == "event" and not changed):
            return False
        due = self._images == "event" or time - self._image_time >= _IMAGE_PERIOD
        if due:
            self._image_time = time
        return due

    def _write_image(self, frame: Frame) -> None:
        image: Image | None = frame.arrays.get("image")
        if image is not None:
            data = cv2.imencode(".jpg", image)[1].tobytes()
            message = CompressedImage(
                timestamp=scene.stamp(frame.time), frame_id=self._name, data=data, format="jpeg"
            )
            self._put("/image", frame.time, message)


def _create(path: Path) -> IO[bytes]:
    """Open a new file of this name, or of the first of NAME-2, NAME-3 … that is free."""
    names = (path.with_stem(f"{path.stem}-{n}") for n in itertools.count(2))
    for name in itertools.chain([path], names):
        try:
            return name.open("xb")
        except FileExistsError:
            continue
    raise AssertionError("endless")


def _configuration(config: CompanionConfig) -> dict[str, str]:
    """Return the keys that were set, for replays with other defaults, and all keys, for people."""
    return {
        "name": config.name,
        "set": config.model_dump_json(exclude_unset=True),
        "resolved": config.model_dump_json(),
    }
