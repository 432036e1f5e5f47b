"""Reading flight logs: whole ones, and the whole part of one that was cut off."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from companion.flightlog.inputs import InputsError, RecordedInputs, decode
from companion.flightlog.recorder import CONFIG
from mavlink_bridge.shared.mcap_file import (
    LogError,
    check_begins,
    read_messages,
    read_metadata,
    whole_records,
)


@dataclass(frozen=True)
class FlightLog:
    """One drone's flight: the keys that its file set, and the inputs and record of each tick."""

    config: dict[str, Any]
    inputs: list[RecordedInputs]
    ticks: list[dict[str, Any]]


def read_log(path: Path) -> FlightLog:
    """Return what a replay needs of a log.

    Raises:
        LogError: the log is missing, empty, foreign or cut off.
    """
    messages = read_messages(path, ["/inputs", "/tick"])
    try:
        inputs = [decode(m.data) for topic, m in messages if topic == "/inputs"]
        ticks = [json.loads(m.data) for topic, m in messages if topic == "/tick"]
        config = json.loads(read_metadata(path)[CONFIG]["set"])
    except (InputsError, ValueError, KeyError) as error:
        raise LogError(f"{path}: not a flight log of a companion: {error}") from error
    if not ticks or len(inputs) != len(ticks):
        raise LogError(f"{path}: {len(ticks)} ticks with {len(inputs)} inputs: nothing to replay")
    return FlightLog(config, inputs, ticks)


def recover(path: Path, to: Path) -> int:
    """Write the messages that `path` still holds to `to`, as a whole log; return their number.

    Raises:
        LogError: `path` is no MCAP file, or holds no whole chunk.
    """
    check_begins(path)
    part = to.with_name(f"{to.name}.part")
    with path.open("rb") as source, part.open("wb") as file:
        copy = _Copy(Writer(file, compression=CompressionType.ZSTD))
        for record in whole_records(source):
            copy.add(record)
        copy.writer.finish()  # type: ignore[no-untyped-call]
    if not copy.count:
        part.unlink()
        raise LogError(f"{path}: holds no whole chunk: nothing to recover")
    part.replace(to)
    return copy.count


class _Copy:
    """Copies records into a new file, and numbers schemas and channels anew."""

    def __init__(self, writer: Writer) -> None:
        self.writer, self.count = writer, 0
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        writer.start(profile="swarm-companion", library="swarm-companion")

    def add(self, record: McapRecord) -> None:
        """Copy one record, unless it belongs to the old file's index.

        A message whose channel is lost has no topic, and is lost, too.
        """
        w = self.writer
        if isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = w.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = w.register_channel(
                record.topic,
                record.message_encoding,
                self._schemas.get(record.schema_id, 0),
                record.metadata,
            )
        elif isinstance(record, Metadata):
            w.add_metadata(record.name, record.metadata)
        elif isinstance(record, Message) and record.channel_id in self._channels:
            w.add_message(
                self._channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
            self.count += 1
