"""Cameras that are not as the companions are told: their pictures are those of that camera."""

import numpy as np
import pytest

from companion.perception.camera import Camera
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.flight.runner import Flight
from sitl_sim.flight.sensors import Sensors
from sitl_sim.scenarios import scenario as scenarios

WORLD = {"cylinders": [{"x": 6.0, "y": 1.0, "radius": 0.4, "height": 30.0}], "drone_radius": 0.2}
P = np.array([[0.0, 0.0, 4.0], [5.0, 1.5, 4.8]])
Q = np.array([quaternion_from_euler(0.1, -0.05, 0.2), [1.0, 0.0, 0.0, 0.0]])


def sensors(*overrides):
    s = scenarios.load("commission", ["drones.count=2", *overrides])
    return Sensors(s, WORLD), s.sensing.actual.drawn(2, s.seed)


def test_the_true_camera_is_turned_zoomed_and_misdated():
    """The magenta ball of the other drone is where a camera like that sees it."""
    made, drawn = sensors(
        "sensing.actual={roll_deg: [-9, 9], pitch_deg: 6, yaw_deg: -8, focal: 1.08, stamp: -0.05}",
        "seed=3",
    )
    assert drawn[0].roll_deg != drawn[1].roll_deg
    assert made.stamp_error(0) == -0.05
    image = made.frame(0, 1.0, P, Q)["image"].astype(int)
    ball = np.minimum(image[..., 0], image[..., 2]) - image[..., 1] > 60
    rows, columns = np.nonzero(ball)
    camera = Camera.equidistant(320, 200, 160.0 / 1.08).turned([drawn[0].roll_deg, 6.0, -8.0])
    body = (P[1] - P[0]) @ rotation_matrix(Q[0])
    there = camera.project((body @ rotation_matrix(camera.mount))[None])[0]
    np.testing.assert_allclose([columns.mean(), rows.mean()], there, atol=1.5)
    plain, _ = sensors("seed=3")
    assert (plain.frame(0, 1.0, P, Q)["image"] != image).mean() > 0.3


def test_a_perfect_detector_and_depth_look_through_the_true_camera():
    made, _ = sensors("sensing.neighbours=truth", "sensing.actual.yaw_deg=10")
    plain, _ = sensors("sensing.neighbours=truth")
    turned, straight = (s.frame(0, 1.0, P, Q)["neighbours"][0, :3] for s in (made, plain))
    angle = np.degrees(np.arccos(np.clip(turned @ straight, -1.0, 1.0)))
    assert angle == pytest.approx(10.0, abs=0.3)
    assert turned[0] > straight[0]  # looks to the left: what it sees is farther right


def test_what_no_camera_can_be_is_refused():
    with pytest.raises(SettingsError, match=r"sensing.actual.focal: takes 0.5…2, or"):
        scenarios.load("commission", ["sensing.actual.focal=[0.9, 3]"])


def test_kernels_are_loaded_before_an_autopilot_with_its_own_time_starts(monkeypatch, tmp_path):
    """Loaded in flight, they had the world lag behind by seconds; with two drones, by minutes."""
    frames = []

    def switch_on(*arguments):
        raise RuntimeError(f"started after {frames}")

    monkeypatch.setattr("sitl_sim.flight.runner.switch_on", switch_on)
    monkeypatch.setattr(Sensors, "frame", lambda self, i, *a: frames.append(i))
    own = {"drones.count": 2, "drones.autopilot": "betaflight", "wire.companion_port": 26540}
    ports = {"wire.gcs_port": 26550, "wire.frame_port": 26560}
    s = scenarios.load("forest", [f"{k}={v}" for k, v in {**own, **ports}.items()])
    with pytest.raises(RuntimeError, match=r"started after \[0, 1\]"):
        Flight(s, tmp_path)
