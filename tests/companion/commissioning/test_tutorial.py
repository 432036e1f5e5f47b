"""The tutorial of docs/commissioning.md, command by command: three boards find what they are."""

import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml

import companion.__main__
import sitl_sim.__main__
from companion.settings.config import load_config
from mavlink_bridge.shared.frames import (
    conjugate,
    multiply,
    quaternion_from_euler,
    rotation_vector,
)
from sitl_sim import load
from sitl_sim.flight.autopilots import true_airframes

PAGE = Path(__file__).parents[3] / "docs" / "commissioning.md"
PROGRAMS = {"companion": companion.__main__.main, "sitl-sim": sitl_sim.__main__.main}


def commands():
    """The lines of the page's shell blocks, as words; patterns of files still to be filled."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]


def filled(words):
    """The words with patterns of files as a shell fills them."""
    return [w for word in words for w in (_files(word) if word.endswith("*.yaml") else [word])]


def _files(pattern):
    return sorted(str(p) for p in Path().glob(pattern))


def angle_between(q, mount_deg):
    """The angle [°] between a camera's true turn and a configured one."""
    roll, pitch, yaw = np.radians(mount_deg)
    there = quaternion_from_euler(roll, -pitch, yaw)
    return np.degrees(np.linalg.norm(rotation_vector(multiply(conjugate(q), there))))


@pytest.mark.timeout(1200)
def test_the_tutorial_finds_what_three_boards_truly_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        assert os.environ.get(variable, "1") == "1"
    for program, *arguments in commands():
        assert PROGRAMS[program](filled(arguments)) == 0, arguments
    out = capsys.readouterr().out
    assert "+  mount_deg: [" in out
    flown = load("runs/commission/scenario.yaml")
    cameras = flown.sensing.actual.drawn(3, flown.seed)
    for n, (camera, airframe) in enumerate(
        zip(cameras, true_airframes(flown), strict=True), start=1
    ):
        c = load_config(Path(f"my-drones/drone{n}.yaml"))
        assert angle_between(camera.turn, c.camera.mount_deg) < 1.0
        assert c.camera.lag == pytest.approx(camera.stamp, abs=0.005)
        assert c.camera.fov_deg == pytest.approx(160.0 / camera.focal, rel=0.01)
        assert c.airframe.hover_thrust == pytest.approx(airframe.hover_thrust, rel=0.03)
        assert c.airframe.drag == pytest.approx(airframe.drag_linear[0] / airframe.mass, abs=0.15)
        assert 0.02 < c.timing.delay < 0.08
        # What the drone is configured with is no secret that it was told.
        told = yaml.safe_load(Path(f"runs/commission/drones/drone{n}/config.yaml").read_text())
        assert "mount_deg" not in told["camera"]


def test_the_commands_for_a_real_drone_are_known():
    """Those need hardware; here, that their programs take them."""
    text = PAGE.read_text("utf-8")
    blocks = re.findall(r"^```console\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [shlex.split(line) for block in blocks for line in block.splitlines()]
    ours = [line for line in lines if any(w.endswith("companion") for w in line[:2])]
    assert len(ours) == 6
    for words in ours:
        at = next(k for k, w in enumerate(words) if w.endswith("companion"))
        companion.__main__._parser().parse_args(words[at + 1 :])  # exits where it is not taken
