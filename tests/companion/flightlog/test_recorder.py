import json
import multiprocessing
import os
import signal
import time
import tracemalloc

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from companion.__main__ import main
from companion.flightlog import corners
from companion.flightlog.reader import read_log, recover
from companion.flightlog.recorder import Recorder
from companion.types import Phase
from mavlink_bridge.shared.mcap_file import Follower, LogError, read_messages, read_metadata
from tests.companion.ticks import COSTS, config, tick

PACKETS = [(False, bytes.fromhex("fd0900000101010000000000000002035104032a2b")), (True, b"abc")]


def write(path, ticks, **log):
    recorder = Recorder(config(path, **log), path)
    for inputs, made in ticks:
        recorder.write(inputs, made, PACKETS, {"deadline_misses": 0}, COSTS)
    return recorder


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    write(path, [tick(n) for n in range(40)]).close()
    return path


def messages(path, topic):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [m for *_, m in reader.iter_decoded_messages(topics=[topic])]


def test_a_log_reads_back_as_it_was_written(whole):
    log = read_log(whole)
    assert log.config == {"name": "tester", "log": {"path": str(whole)}}  # what was set
    assert len(log.ticks) == len(log.inputs) == 40
    inputs, made = tick(7)
    read = log.inputs[7]
    assert read.time == inputs.time
    assert read.frame_time == inputs.frame.time
    assert read.datagrams == [PACKETS[0][1]]
    for before, now in zip(made.seen.drones, read.drones, strict=True):
        assert (before.direction == now.direction).all()
        assert (before.range, before.score) == (now.range, now.score)
    assert [t.distance for t in made.seen.trunks] == [t.distance for t in read.trunks]
    assert log.ticks[7]["command"]["c"] == 9.8
    np.testing.assert_allclose(log.ticks[7]["own"]["p"], made.vehicle.state.p, atol=1e-4)


def test_viewers_find_foxgloves_types(whole):
    pose, transform = messages(whole, "/pose")[3].pose, messages(whole, "/tf")[3]
    p = tick(3)[1].vehicle.state.p
    assert (pose.position.x, pose.position.y, pose.position.z) == tuple(p)
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "tester")
    entities = {e.id: e for e in messages(whole, "/scene")[5].entities}
    assert len(messages(whole, "/scene")) == 20
    assert len(entities["plan"].lines[0].points) == 21
    assert len(entities["tracks"].spheres) == 6
    assert [t.text for t in entities["critical"].texts] == ["0: 0.50", "1: 0.50", "2: 0.50"]
    assert len(entities["obstacles"].cylinders) == 5


def test_events_tell_changes_only(tmp_path):
    path = tmp_path / "flight.mcap"
    phases = [Phase.FLY] * 3 + [Phase.LAND] * 3
    write(path, [tick(n, phase) for n, phase in enumerate(phases)]).close()
    texts = [m.message for m in messages(path, "/events")]
    assert texts == ["phase: - -> fly", "guard: - -> plan", "goal: - -> 0", "phase: fly -> land"]


@pytest.mark.parametrize(("images", "count"), [("none", 0), ("periodic", 3), ("event", 1)])
def test_pictures_by_config(tmp_path, images, count):
    path = tmp_path / "flight.mcap"
    picture = np.full((50, 80, 3), (200, 30, 10), np.uint8)
    write(path, [tick(n, image=picture) for n in range(25)], images=images).close()
    found = messages(path, "/image")
    assert len(found) == count
    for image in found:
        shown = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
        assert np.abs(shown.astype(int) - picture).max() < 8


@pytest.mark.row("20")
def test_a_full_disk_ends_the_log_and_not_the_flight(tmp_path):
    recorder = write(tmp_path / "flight.mcap", [])
    recorder._file.close()
    recorder._file = recorder._writer._file = open("/dev/full", "wb", 0)  # noqa: SIM115, PTH123
    for n in range(20):
        recorder.write(*tick(n), PACKETS, {}, COSTS)
    assert "No space left" in recorder.failed
    recorder.close()


def test_the_memory_of_a_log_does_not_grow(tmp_path):
    pair = tick(3)
    recorder = write(tmp_path / "flight.mcap", [pair] * 200)
    tracemalloc.start()
    for _ in range(1000):
        recorder.write(*pair, PACKETS, {}, COSTS)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    recorder.close()
    assert grown < 50_000  # bytes: 200 chunks
    assert len(read_log(tmp_path / "flight.mcap").ticks) == 1200
    assert len(messages(tmp_path / "flight.mcap", "/pose")) == 1200


def test_a_log_with_a_time_in_its_name_replaces_no_older_log(tmp_path):
    path = tmp_path / "flight-20260101T000000Z.mcap"
    pattern = config(tmp_path / "flight-{time}.mcap")
    for n in range(1, 4):
        recorder = Recorder(pattern, path)
        recorder.write(*tick(n), PACKETS, {}, COSTS)
        recorder.close()
    names = [path, *(path.with_stem(f"{path.stem}-{n}") for n in (2, 3))]
    assert sorted(tmp_path.glob("*.mcap")) == sorted(names)
    assert [read_log(name).ticks[0]["time"] for name in names] == [0.1, 0.2, 0.3]
    assert all(name.with_suffix(".tlog").stat().st_size for name in names)
    assert recorder.path == names[-1]


def _fly_for_ever(path, latest):
    recorder = Recorder(config(path), path)
    for n in range(100_000):
        recorder.write(*tick(n), PACKETS, {}, COSTS)
        latest.value = 0.1 * n
        time.sleep(0.002)


@pytest.mark.row("20")
def test_sigkill_loses_less_than_a_second(tmp_path):
    context = multiprocessing.get_context("fork")
    rng = np.random.default_rng(20)
    for n in range(20):
        # Without a lock: one that dies with the process would never be let go.
        path, latest = tmp_path / f"{n}.mcap", context.Value("d", 0.0, lock=False)
        process = context.Process(target=_fly_for_ever, args=(path, latest))
        process.start()
        while latest.value < rng.uniform(1.0, 6.0):
            time.sleep(0.001)
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        saved = tmp_path / f"{n}.saved.mcap"
        assert recover(path, saved) > 0
        assert read_log(saved).ticks[-1]["time"] >= latest.value - 1.0


def test_a_cut_at_any_byte_recovers_whole_ticks(whole, tmp_path):
    data, counts = whole.read_bytes(), []
    cut, saved = tmp_path / "cut.mcap", tmp_path / "saved.mcap"
    for size in np.linspace(len(data) - 9, 4000, 40).astype(int):
        cut.write_bytes(data[:size])
        try:
            recover(cut, saved)
        except LogError:
            counts.append(0)
            continue
        counts.append(len(read_log(saved).ticks))
    assert counts[0] == 40
    assert counts == sorted(counts, reverse=True)
    assert 0 in counts


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        (b"", "empty"),
        (b"GIF89a, or some other thing", "not an MCAP file"),
        (b"\x89MCAP0\r\n" + b"\x01" * 40, "cut off; `companion log recover"),
    ],
)
def test_a_bad_log_is_one_clear_line_and_exit_2(tmp_path, capsys, content, words):
    path = tmp_path / "flight.mcap"
    if content is not None:
        path.write_bytes(content)
    assert main(["replay", str(path)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{path}: {words}")


def test_a_growing_log_is_followed_tick_by_tick(tmp_path):
    path = tmp_path / "flight.mcap"
    follower = Follower(path, "/tick")
    assert follower.new() == []
    recorder, seen = write(path, []), []
    for n in range(23):
        recorder.write(*tick(n), PACKETS, {}, COSTS)
        seen += [json.loads(m.data)["time"] for m in follower.new()]
        assert len(seen) >= n - 4
    recorder.close()
    seen += [json.loads(m.data)["time"] for m in follower.new()]
    assert seen == [tick(n)[0].time for n in range(23)]
    assert follower.new() == []


def test_recover_from_the_command_line(whole, tmp_path, capsys):
    cut = tmp_path / "flight.mcap"
    cut.write_bytes(whole.read_bytes()[:-3000])
    assert main(["log", "recover", str(cut)]) == 0
    saved = tmp_path / "flight.recovered.mcap"
    assert str(saved) in capsys.readouterr().out
    assert read_log(saved).ticks
    assert not list(tmp_path.glob("*.part"))
    cut.write_bytes(b"\x89MCAP0\r\n" + b"\x01" * 40)
    assert main(["log", "recover", str(cut)]) == 2
    assert "nothing to recover" in capsys.readouterr().err


def test_a_log_is_not_recovered_into_itself(whole, tmp_path, monkeypatch, capsys):
    """A daemon that still writes the log would go on in a file without a name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.mcap").write_bytes(whole.read_bytes()[:-3000])
    (tmp_path / "link.mcap").symlink_to("flight.mcap")
    before = (tmp_path / "flight.mcap").read_bytes()
    for name in ("flight.mcap", str(tmp_path / "flight.mcap"), "link.mcap"):
        assert main(["log", "recover", "flight.mcap", "--out", name]) == 2
        assert "is the log itself" in capsys.readouterr().err
    assert (tmp_path / "flight.mcap").read_bytes() == before


def test_recording_costs_less_than_2_percent_of_a_tick(tmp_path):
    ticks = [tick(n) for n in range(100)]
    recorder = write(tmp_path / "flight.mcap", ticks[:10])
    taken = []
    for inputs, made in ticks[10:]:
        started = time.thread_time()  # of the processor: other programs do not count
        recorder.write(inputs, made, PACKETS, {}, COSTS)
        taken.append(time.thread_time() - started)
    recorder.close()
    assert np.median(taken) < 0.02 * config().timing.period


def test_the_schema_names_what_a_tick_holds(whole):
    with whole.open("rb") as file:
        schemas = {c.topic: s for s, c, _ in make_reader(file).iter_messages()}
    named = set(json.loads(schemas["/tick"].data)["properties"])
    assert named == {*read_log(whole).ticks[0]}


def test_corners_are_logged_while_the_companion_flies(tmp_path):
    path = tmp_path / "flight.mcap"
    scene = np.random.default_rng(2).integers(0, 255, (20, 35, 3), np.uint8)
    scene = cv2.resize(scene, (700, 400), interpolation=cv2.INTER_CUBIC)
    pictures = [np.ascontiguousarray(scene[:, 3 * n : 3 * n + 640]) for n in range(8)]
    phases = [Phase.TAKEOFF] * 3 + [Phase.FLY] * 5
    ticks = [
        tick(n, phase, image) for n, (phase, image) in enumerate(zip(phases, pictures, strict=True))
    ]
    write(path, ticks, corners=True).close()
    pairs = [corners.decode(m.data) for _, m in read_messages(path, [corners.TOPIC])]
    assert [(p.before, p.after) for p in pairs] == [(0.3, 0.4), (0.4, 0.5), (0.5, 0.6), (0.6, 0.7)]
    moved = np.concatenate([p.pixels[:, 2:] - p.pixels[:, :2] for p in pairs])
    np.testing.assert_allclose(np.median(moved, axis=0), [-3.0, 0.0], atol=0.1)
    lens = json.loads(read_metadata(path)[corners.CAMERA]["calibration"])
    assert (lens["width"], lens["height"]) == (640, 400)
    assert len(read_log(path).ticks) == 8
    write(path, ticks).close()
    assert corners.CAMERA not in read_metadata(path)
    assert not read_messages(path, [corners.TOPIC])
