"""The recorded flight; `--renew-flight` records it anew."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from companion.flightlog.recorder import CONFIG
from sitl_sim.__main__ import main

HERE = Path(__file__).parent
FLIGHT = HERE.parents[1] / "companion" / "bench" / "flight.mcap"
_KEPT = ("/inputs", "/tick")


def pytest_addoption(parser):
    parser.addoption(
        "--renew-flight",
        action="store_true",
        help="fly tests/replay/flight.yaml and keep its log as the recorded flight",
    )


@pytest.fixture(scope="session")
def flight(request, tmp_path_factory):
    if request.config.getoption("--renew-flight", default=False):
        out = tmp_path_factory.mktemp("flight")
        main(["run", str(HERE / "flight.yaml"), "--out", str(out)])
        keep(out / "drones" / "drone5" / "flight.mcap", FLIGHT)
    return FLIGHT


def keep(log, to):
    """Copy the part of a log that a replay needs, in one chunk: a tenth of it."""
    with log.open("rb") as source, to.open("wb") as file:
        reader, writer = make_reader(source), Writer(file, chunk_size=1 << 26)
        writer.start(profile="swarm-companion", library="swarm-companion")
        for metadata in reader.iter_metadata():
            if metadata.name == CONFIG:
                writer.add_metadata(CONFIG, metadata.metadata)
        channels = {
            topic: writer.register_channel(topic, "json" if topic == "/tick" else "", 0)
            for topic in _KEPT
        }
        for _, channel, m in reader.iter_messages(topics=_KEPT):
            writer.add_message(channels[channel.topic], m.log_time, m.data, m.publish_time)
        writer.finish()
