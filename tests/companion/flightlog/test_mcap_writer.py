"""Our MCAP writer against the mcap package's."""

import io

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from companion.flightlog.mcap_writer import McapWriter

MESSAGES = [(1 + n % 2, 1000 * n, bytes([n]) * 300, n) for n in range(40)]
CHUNK = 2000  # bytes


def ours(folder):
    file = io.BytesIO()
    writer = McapWriter(file, folder, CHUNK)
    writer.add_metadata("config", {"name": "a"})
    schema = writer.register_schema("Tick", "jsonschema", b"{}")
    for topic in ("/tick", "/inputs"):
        writer.register_channel(topic, "json", schema, {"drone": "a"})
    for n, (channel, time, data, sequence) in enumerate(MESSAGES):
        writer.add_message(channel, time, data, sequence)
        if n == 30:
            writer.flush()
    writer.finish()
    writer.close()
    return file.getvalue()


def theirs():
    file = io.BytesIO()
    writer = Writer(file, chunk_size=CHUNK, compression=CompressionType.ZSTD)
    writer.start(profile="swarm-companion", library="swarm-companion")
    writer.add_metadata("config", {"name": "a"})
    schema = writer.register_schema("Tick", "jsonschema", b"{}")
    for topic in ("/tick", "/inputs"):
        writer.register_channel(topic, "json", schema, {"drone": "a"})
    for n, (channel, time, data, sequence) in enumerate(MESSAGES):
        writer.add_message(channel, time, data, time, sequence)
        if n == 30:
            writer.flush()
    writer.finish()
    return file.getvalue()


def test_the_bytes_are_those_of_the_mcap_package(tmp_path):
    assert ours(tmp_path) == theirs()


def test_the_summary_finds_every_chunk(tmp_path):
    summary = make_reader(io.BytesIO(ours(tmp_path)), validate_crcs=True).get_summary()
    assert summary.statistics.message_count == len(MESSAGES)
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 3
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (
        0,
        39000,
    )
