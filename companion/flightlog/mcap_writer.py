"""MCAP files (https://mcap.dev/spec) written in bounded memory.

The writer of the mcap package keeps the index of all chunks in memory until the file ends: 5 MB
for each hour that a daemon runs. Here the index waits in a temporary file; the bytes are the same.
"""

from __future__ import annotations

import struct
import tempfile
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

_COPY = 1 << 16  # bytes of the index that are copied at once
# A message's opcode and length, its channel, number, and times of log and publication. A tick has
# several messages; the package writes each by a dozen small calls.
_MESSAGE = struct.Struct("<BQHIQQ")
# Of an index of a chunk's messages: opcode, length, channel, bytes of what follows.
_INDEX = struct.Struct("<BQHI")
_PREFIX = 9  # bytes of opcode and length, which the length leaves out


class McapWriter:
    """Writes one file.

    Raises:
        OSError: from every method, where the disk is full or read-only.
    """

    def __init__(self, file: IO[bytes], folder: Path, chunk_size: int) -> None:
        """Begin `file`; its index waits in `folder`.

        chunk_size: bytes, before compression, at which a chunk ends by itself.
        """
        self._file = file
        self._index = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (for as long as the log)
        self._chunk_size = chunk_size
        self._chunk = _OpenChunk()
        self._compressor = zstandard.ZstdCompressor()  # one for all: its tables take long to make
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)  # messages by channel
        self._chunks = 0
        self._first, self._last = 0, 0  # ns
        file.write(MCAP0_MAGIC)
        file.write(_encoded([Header("swarm-companion", "swarm-companion")]))

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record."""
        record, offset = _encoded([Metadata(name, data)]), self._file.tell()
        self._file.write(record)
        self._metadata.append(MetadataIndex(offset, len(record), name))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Return the number of a new schema."""
        self._schemas.append(Schema(len(self._schemas) + 1, data, encoding, name))
        self._chunk.add(self._schemas[-1])
        return self._schemas[-1].id

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: dict[str, str]
    ) -> int:
        """Return the number of a new channel; schema: number, 0: none."""
        self._channels.append(Channel(len(self._channels) + 1, topic, encoding, metadata, schema))
        self._chunk.add(self._channels[-1])
        return self._channels[-1].id

    def add_message(self, channel: int, time: int, data: bytes, sequence: int) -> None:
        """Append a message; time: ns."""
        self._first = min(self._first, time) if self._counts else time
        self._last = max(self._last, time)
        self._counts[channel] += 1
        self._chunk.add_message(channel, time, data, sequence)
        if self._chunk.size > self._chunk_size:
            self._end_chunk()

    def flush(self) -> None:
        """End the chunk and hand everything to the system."""
        self._end_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Write the summary, by which readers find their way."""
        self._end_chunk()
        self._file.write(_encoded([DataEnd(0)]))
        start, checksum = self._file.tell(), 0
        offsets: list[McapRecord] = []
        for opcode, blocks in self._summary():
            at = self._file.tell()
            checksum = self._write(blocks, checksum)
            offsets.append(SummaryOffset(opcode, at, self._file.tell() - at))
        at = self._file.tell()
        checksum = self._write([_encoded(offsets)], checksum)
        footer = _encoded([Footer(start, at, 0)])
        checksum = zlib.crc32(footer[:-4], checksum)
        self._file.write(_encoded([Footer(start, at, checksum)]) + MCAP0_MAGIC)

    def close(self) -> None:
        """Forget the index."""
        self._index.close()

    def _end_chunk(self) -> None:
        if self._chunk.messages:
            record, index = self._chunk.encoded(self._file.tell(), self._compressor)
            self._file.write(record)
            self._index.write(index)
            self._chunks += 1
            self._chunk = _OpenChunk()

    def _write(self, blocks: Iterable[bytes], checksum: int) -> int:
        for block in blocks:
            self._file.write(block)
            checksum = zlib.crc32(block, checksum)
        return checksum

    def _summary(self) -> Iterator[tuple[Opcode, Iterable[bytes]]]:
        """Return the groups of records that the summary holds."""
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        yield Opcode.SCHEMA, [_encoded(self._schemas)]
        yield Opcode.CHANNEL, [_encoded(self._channels)]
        yield Opcode.STATISTICS, [_encoded([statistics])]
        self._index.seek(0)
        yield Opcode.CHUNK_INDEX, iter(lambda: self._index.read(_COPY), b"")
        yield Opcode.ATTACHMENT_INDEX, []
        yield Opcode.METADATA_INDEX, [_encoded(self._metadata)]


class _OpenChunk:
    """The records of the chunk under way."""

    def __init__(self) -> None:
        self._records = bytearray()
        self.messages: dict[int, list[int]] = {}  # by channel: time [ns] and place of each, in turn
        self._times = (0, 0)  # ns, first and last

    @property
    def size(self) -> int:
        """Bytes so far."""
        return len(self._records)

    def add(self, record: Schema | Channel) -> None:
        self._records += _encoded([record])

    def add_message(self, channel: int, time: int, data: bytes, sequence: int) -> None:
        first, last = self._times if self.messages else (time, time)
        self._times = min(first, time), max(last, time)
        self.messages.setdefault(channel, []).extend((time, len(self._records)))
        length = _MESSAGE.size - _PREFIX + len(data)
        self._records += _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, time, time)
        self._records += data

    def encoded(self, offset: int, compressor: zstandard.ZstdCompressor) -> tuple[bytes, bytes]:
        """Return the chunk with its message indexes, and its entry of the summary's index.

        offset: place in the file [bytes] at which the chunk is to begin.
        """
        data = bytes(self._records)
        packed = compressor.compress(data)
        first, last = self._times
        chunk = _encoded([Chunk("zstd", packed, last, first, zlib.crc32(data), len(data))])
        offsets, indexes = {}, bytearray()
        for channel, index in self.messages.items():
            offsets[channel] = offset + len(chunk) + len(indexes)
            size = 8 * len(index)
            indexes += _INDEX.pack(
                Opcode.MESSAGE_INDEX, _INDEX.size - _PREFIX + size, channel, size
            )
            indexes += struct.pack(f"<{len(index)}Q", *index)
        entry = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=offset,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=last,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=first,
            uncompressed_size=len(data),
        )
        return chunk + indexes, _encoded([entry])


def _encoded(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
