"""A flight as tables and as one log of the swarm: true times, one tree of frames."""

import csv
import json
import re
import subprocess
import sys
from importlib.metadata import version

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader

import sitl_sim
from mavlink_bridge.shared.frames import rotation_matrix
from sitl_sim.__main__ import main
from sitl_sim.recording.run_folder import own_frames
from sitl_sim.recording.tables import tick_columns, write_csv

SCENARIO = """
fileversion: 1
name: pair
seed: 3
world: {cylinders: [{x: 5.0, y: 0.4, radius: 0.5, height: 6.0}]}
drones: {count: 2, spacing: 1.5, heading_deg: 0.0, frame_yaw_deg: random}
mission: {targets: [[8.0, 0.0, 2.0]], home: false, time_limit: 16.0}
sensing: {neighbours: truth, obstacles: map}
"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    (folder / "pair.yaml").write_text(SCENARIO)
    return sitl_sim.fly(folder / "pair.yaml", out=folder / "run")


@pytest.fixture(scope="module")
def swarm(flight):
    assert main(["export", str(flight.folder), "--to", "mcap"]) == 0
    with (flight.folder / "swarm.mcap").open("rb") as file:
        reader = make_reader(file)
        messages = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        return messages, {m.name: m.metadata for m in reader.iter_metadata()}


def test_every_topic_of_every_drone_stands_under_its_name(swarm, flight):
    messages, about = swarm
    topics = {topic for topic, _, _ in messages}
    for name in ("drone1", "drone2"):
        assert {f"/{name}{t}" for t in ("/tick", "/inputs", "/pose", "/tf", "/scene")} <= topics
        count = sum(topic == f"/{name}/tick" for topic, _, _ in messages)
        assert count == len(flight.ticks(name))
        assert f'"name":"{name}"' in "".join(about[f"{name}/config"].values())
    assert about["flight"]["version"] == version("swarm-companion")
    assert about["flight"]["seed"] == "3"
    assert about["flight"]["began"].startswith("20")


def test_the_times_are_those_of_the_world(swarm, flight):
    boot = {n: f.boot for n, f in zip(flight.names, own_frames(*_world(flight)), strict=True)}
    assert len(set(boot.values())) == 2  # the clocks differ, or the test shows nothing
    for name in flight.names:
        stamps = [t for topic, t, _ in swarm[0] if topic == f"/{name}/tick"]
        wanted = [tick["time"] - boot[name] for tick in flight.ticks(name)]
        np.testing.assert_allclose(np.array(stamps) / 1e9, np.maximum(wanted, 0.0), atol=1e-6)
        poses = [d for topic, _, d in swarm[0] if topic == f"/{name}/pose"]
        last = PoseInFrame.FromString(poses[-1])
        inner = last.timestamp.seconds + last.timestamp.nanos / 1e9
        assert inner == pytest.approx(stamps[-1] / 1e9, abs=0.2)


def test_a_belief_stands_where_the_drone_is_through_the_tree_of_frames(swarm, flight):
    messages, _ = swarm
    fixed = [FrameTransform.FromString(d) for t, _, d in messages if t == "/truth/tf"]
    maps = {f.child_frame_id: f for f in fixed if f.child_frame_id.endswith("/map")}
    assert {f.parent_frame_id for f in fixed} == {"world"}
    for i, name in enumerate(flight.names):
        time, data = [(t, d) for topic, t, d in messages if topic == f"/{name}/tf"][-1]
        own = FrameTransform.FromString(data)
        assert (own.parent_frame_id, own.child_frame_id) == (f"{name}/map", name)
        frame = maps[own.parent_frame_id]
        place = _p(frame.translation) + rotation_matrix(_q(frame.rotation)) @ _p(own.translation)
        truth = flight.position[np.searchsorted(flight.t, time / 1e9), i]
        assert np.linalg.norm(truth[:2] - flight.position[0, i, :2]) > 0.5  # it has flown
        np.testing.assert_allclose(place, truth, atol=0.3)


def test_the_truth_is_in_the_log(swarm, flight):
    poses = [PoseInFrame.FromString(d) for topic, _, d in swarm[0] if topic == "/truth/drone2/pose"]
    assert len(poses) == len(flight.t[::5])
    np.testing.assert_allclose(_p(poses[-1].pose.position), flight.position[::5][-1, 1])
    (scene,) = [SceneUpdate.FromString(d) for topic, _, d in swarm[0] if topic == "/truth/scene"]
    (trunk,) = scene.entities[0].cylinders
    assert (trunk.pose.position.x, trunk.pose.position.z) == (5.0, 3.0)
    assert (trunk.size.x, trunk.size.z) == (1.0, 6.0)


def test_what_a_camera_showed_and_what_was_found_in_it_meet_at_one_instant(swarm, flight):
    messages, _ = swarm
    marks = {
        t: ImageAnnotations.FromString(d) for k, t, d in messages if k == "/drone1/annotations"
    }
    pictures = [
        (t, CompressedImage.FromString(d)) for k, t, d in messages if k == "/truth/drone1/camera"
    ]
    assert len(pictures) > 10
    found = 0
    for time, picture in pictures:
        image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
        assert image.shape == (400, 640, 3)
        for ring in marks[time].circles:  # the same instant, or viewers show none
            if ring.outline_color.g == 1.0:  # a drone: the magenta ball is in its ring
                u, v, r = round(ring.position.x), round(ring.position.y), 5
                patch = image[max(v - r, 0) : v + r, max(u - r, 0) : u + r].astype(int)
                found += bool((patch[..., [0, 2]].min(axis=-1) - patch[..., 1] > 60).any())
    assert found > 3


def test_the_layout_for_foxglove_names_topics_of_the_log_and_its_own_panels(swarm, flight):
    topics = {topic for topic, _, _ in swarm[0]}
    layout = json.loads((flight.folder / "swarm.foxglove.json").read_text())
    panels = layout["configById"]
    assert set(_leaves(layout["layout"])) == set(panels)
    named = set(panels["3D!swarm"]["topics"])
    named |= {p["value"].rpartition(".")[0] for p in panels["Plot!speeds"]["paths"]}
    image = panels["Image!camera"]["imageMode"]
    named |= {image["imageTopic"], *image["annotations"], panels["RosOut!events"]["topicToRender"]}
    assert named <= topics


def _leaves(node):
    if isinstance(node, str):
        return [node]
    return [*_leaves(node["first"]), *_leaves(node["second"])]


def test_rerun_opens_the_log_with_its_blueprint(flight, tmp_path):
    """Rerun's own program finds no fault in what was written, and reads it back."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed; .ci/run installs it")
    out = tmp_path / "swarm.rrd"
    assert main(["export", str(flight.folder), "--to", "rerun", "--out", str(out)]) == 0
    assert "without error" in _rerun("verify", out)
    said = _rerun("print", out)
    for entity, drawn in {
        "/truth/obstacles": "Points3D:positions",
        "/truth/drone2/pose": "InstancePoses3D:translations",
        "/truth/tf": "Transform3D:parent_frame",
        "/drone1/tf": "Transform3D:child_frame",
        "/drone2/pose": "InstancePoses3D:translations",
        "/drone1/events": "TextLog:text",
        "/truth/drone1/camera": "EncodedImage:blob",
    }.items():
        assert re.search(rf" - {entity} - data columns: .*{drawn}", said), entity
    for entity in ("/truth/drone2/pose", "/drone2/pose"):  # what is drawn at the poses
        bodies = rf" - {entity} - data columns: .*Ellipsoids3D:half_sizes"
        assert re.search(bodies, said), entity
    assert re.search(r"Blueprint,\s+\"swarm-companion\"", said)
    assert re.search(r"Recording,\s+\"swarm-companion\"", said)


def _rerun(*arguments):
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", *map(str, arguments)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout + done.stderr


def test_tables_hold_every_instant_of_every_drone(flight, tmp_path):
    assert main(["export", str(flight.folder), "--to", "csv", "--out", str(tmp_path)]) == 0
    with (tmp_path / "truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(flight.t)
    assert [float(rows[-1][k]) for k in "xyz"] == flight.position[-1, 1].tolist()
    with (tmp_path / "ticks.csv").open() as file:
        ticks = list(csv.DictReader(file))
    assert len(ticks) == sum(len(flight.ticks(n)) for n in flight.names)
    assert {"t", "drone", "phase", "own.p.0", "goal.index"} <= set(ticks[0])
    assert ticks[0]["drone"] == "drone1"
    assert len(tick_columns(flight.run())["t"]) == len(ticks)


def test_a_table_in_csv_is_as_written(tmp_path):
    t, ok = np.array([0.5, np.nan]), np.array([True, False])
    columns = {"t": t, "name": np.array(["a,b", ""]), "ok": ok}
    write_csv(tmp_path / "t.csv", columns)
    assert (tmp_path / "t.csv").read_bytes() == b't,name,ok\r\n0.5,"a,b",True\r\n,,False\r\n'


def test_parquet_without_pyarrow_names_its_extra(flight, monkeypatch, capsys):
    monkeypatch.setattr("sitl_sim.commands.extras.find_spec", _without_pyarrow)
    assert main(["export", str(flight.folder), "--to", "parquet"]) == 2
    assert "pip install 'swarm-companion[export]'" in capsys.readouterr().err


def test_a_folder_without_a_flight_is_told(tmp_path, capsys):
    assert main(["export", str(tmp_path)]) == 2
    assert "world.json: cannot be read" in capsys.readouterr().err


def _without_pyarrow(module):
    return None if module == "pyarrow" else module


def _world(flight):
    run = flight.run()
    return run.scenario, json.loads((flight.folder / "world.json").read_text())


def _p(v):
    return np.array([v.x, v.y, v.z])


def _q(q):
    return np.array([q.w, q.x, q.y, q.z])
