"""What a flight tells is found; what it cannot tell is refused, with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from companion.commissioning.findings import changes, find
from tests.companion.commissioning.made_flight import made_flight

CAMERA = ["mount roll", "mount pitch", "mount yaw", "picture lag", "focal scale"]


def found(flight):
    return {f.name: f for f in find(flight)}


@pytest.mark.parametrize("seed", [11, 12])
def test_mount_lag_focal_thrust_and_drag_are_found_within_their_doubt(seed):
    rng = np.random.default_rng(seed)
    true = {
        **dict(zip(CAMERA[:3], rng.uniform(-10, 10, 3), strict=True)),
        "picture lag": rng.uniform(-0.1, 0.1),
        "focal scale": rng.uniform(0.9, 1.1),
        "hover thrust": rng.uniform(0.27, 0.4),
        "drag": rng.uniform(0.1, 0.4),
    }
    true["picture lag"] = round(true["picture lag"], 2)
    values = list(true.values())
    flight = made_flight(values[:3], *values[3:], seed=seed)
    told = found(flight)
    assert all(f.told for f in told.values())
    for name, value in true.items():
        assert abs(told[name].value - value) < 3.0 * told[name].sigma, name
    configured = changes(flight, list(told.values()))
    assert configured["camera", "mount_deg"] == pytest.approx(values[:3], abs=0.6)
    assert configured["camera", "fov_deg"] == pytest.approx(160.0 / values[4], rel=0.006)
    assert configured["airframe", "hover_thrust"] == pytest.approx(values[5], rel=0.01)


def test_a_drone_that_only_yaws_cannot_tell_where_its_camera_points_about_yaw():
    told = found(made_flight(swings=(0.0, 0.0, 0.8), heave=0.0))
    assert "too little about roll and pitch" in told["mount yaw"].refusal
    assert told["mount roll"].told
    assert told["mount pitch"].told
    assert told["focal scale"].told
    assert "too slow" in told["drag"].refusal


def test_a_drone_that_does_not_turn_tells_nothing_of_its_camera():
    flight = made_flight(swings=(0.0, 0.0, 0.0), heave=0.0)
    told = found(flight)
    assert not any(told[name].told for name in CAMERA)
    assert "roll and pitch and yaw" in told["picture lag"].refusal
    assert not any(section == "camera" for section, _ in changes(flight, list(told.values())))


def test_a_mount_that_gives_way_in_flight_is_refused():
    told = found(made_flight(mount=(0.0, 0.0, 0.0), moved=(0.0, 8.0, 0.0)))
    assert "the halves of the flight disagree" in told["mount pitch"].refusal


def test_a_mirrored_picture_is_refused():
    told = found(made_flight(mirrored=True))
    assert all("moves as the gyro says" in told[name].refusal for name in CAMERA)
    assert told["hover thrust"].told


def test_pictures_in_which_there_is_nothing_to_follow_tell_nothing():
    flight = made_flight()
    bare = [replace(p, pixels=p.pixels[:1]) for p in flight.pairs]
    for pairs in (bare, [], flight.pairs[:20]):
        told = found(replace(flight, pairs=pairs))
        assert all("is there anything to see?" in told[name].refusal for name in CAMERA)
        assert told["hover thrust"].told
