"""Readers of MCAP files that are whole, cut off, or still being written."""

from __future__ import annotations

import struct
from collections.abc import Container, Iterable, Iterator
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

# Errors of the reader and its decompressors on damaged bytes; OSError for an offset outside the
# file.
_DAMAGED = (
    McapError,
    EOFError,
    ValueError,
    KeyError,
    RuntimeError,
    OverflowError,
    MemoryError,
    OSError,
    struct.error,
    ZstdError,
)
_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, logged, published
_CHANNEL, _MESSAGE, _CHUNK = 0x04, 0x05, 0x06


class LogError(ValueError):
    """A file is not a whole flight log; the message names the file, the fault and the remedy."""


def read_messages(path: Path, topics: Iterable[str]) -> list[tuple[str, Message]]:
    """Return (topic, message) of these topics, oldest first.

    Raises:
        LogError: the file is missing, empty, cut off, or not an MCAP file.
    """
    check_whole(path)
    wanted = set(topics)
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            if summary is None:
                return []
            names = {n: c.topic for n, c in summary.channels.items() if c.topic in wanted}
            found: list[Message] = []
            for index in summary.chunk_indexes:
                file.seek(index.chunk_start_offset + _RECORD.size)
                found += _picked(Chunk.read(ReadDataStream(file)), names.keys())
    except _DAMAGED as error:
        raise LogError(f"{path}: damaged: {error}") from error
    return [(names[m.channel_id], m) for m in sorted(found, key=attrgetter("log_time"))]


def _picked(chunk: Chunk, channels: Container[int]) -> Iterator[Message]:
    """Yield the messages of these channels; of other channels only the heads are read."""
    stream, length = get_chunk_data_stream(chunk)
    data, at = stream.read(length), 0
    while at < length:
        opcode, size = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if opcode == _MESSAGE:
            channel, sequence, logged, published = _MESSAGE_HEAD.unpack_from(data, at)
            if channel in channels:
                text = data[at + _MESSAGE_HEAD.size : at + size]
                yield Message(channel, logged, text, published, sequence)
        at += size


def read_metadata(path: Path) -> dict[str, dict[str, str]]:
    """Return the metadata records of a whole file, by name."""
    with path.open("rb") as file:
        return {m.name: m.metadata for m in make_reader(file).iter_metadata()}


def whole_records(file: IO[bytes]) -> Iterator[McapRecord]:
    """Yield the records in file order, chunks unpacked, up to the place where the file is cut."""
    try:
        yield from StreamReader(file).records
    except _DAMAGED:
        return


def salvage(path: Path, topic: str) -> list[Message]:
    """Return the readable messages of one topic of a damaged file; none without a file."""
    try:
        with path.open("rb") as file:
            return list(_of_topic(whole_records(file), topic, set()))
    except OSError:
        return []


def check_whole(path: Path) -> None:
    """Raise LogError unless the file begins and ends as a whole MCAP does."""
    check_begins(path)
    with path.open("rb") as file:
        file.seek(-len(MCAP0_MAGIC), 2)
        if file.tell() == 0 or file.read() != MCAP0_MAGIC:
            raise LogError(f"{path}: cut off; `companion log recover {path}` saves what it holds")


def check_begins(path: Path) -> None:
    """Raise LogError unless the file exists and begins as an MCAP does."""
    try:
        with path.open("rb") as file:
            head = file.read(len(MCAP0_MAGIC))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    if not head:
        raise LogError(f"{path}: empty")
    if head != MCAP0_MAGIC:
        raise LogError(f"{path}: not an MCAP file")


class Follower:
    """Messages of one topic of a file that is still being written."""

    def __init__(self, path: Path, topic: str) -> None:
        self._path, self._topic = path, topic
        self._at = len(MCAP0_MAGIC)
        self._channels: set[int] = set()

    def new(self) -> list[Message]:
        """Return the messages completed since the last call; none where there is no file yet.

        A damaged record is skipped.
        """
        try:
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read()
        except OSError:
            return []
        found: list[Message] = []
        at = 0
        while at + _RECORD.size <= len(data):
            opcode, length = _RECORD.unpack_from(data, at)
            end = at + _RECORD.size + length
            if end > len(data):
                break
            found += self._opened(opcode, data[at + _RECORD.size : end])
            at = end
        self._at += at
        return found

    def _opened(self, opcode: int, data: bytes) -> list[Message]:
        """Return the topic's messages in one record."""
        body = ReadDataStream(BytesIO(data))
        try:
            if opcode == _CHANNEL:
                return list(_of_topic([Channel.read(body)], self._topic, self._channels))
            if opcode == _CHUNK:
                records = breakup_chunk(Chunk.read(body))
                return list(_of_topic(records, self._topic, self._channels))
        except _DAMAGED:
            return []
        return []


def _of_topic(records: Iterable[McapRecord], topic: str, channels: set[int]) -> Iterator[Message]:
    """Yield the topic's messages; add the topic's channels to `channels`."""
    for record in records:
        if isinstance(record, Channel) and record.topic == topic:
            channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id in channels:
            yield record
