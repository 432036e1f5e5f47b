"""A velocity that is wrong with its position is corrected by the ground; a right one is not."""

import numpy as np
import pytest

from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.velocity_by_sight import VelocityBySight, VelocityFromGround
from companion.perception.ground_flow import GroundFlow, way_over_ground
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.wire.messages import LocalPosition, VehicleState
from tests.companion.estimation.ground_flows import HEIGHT, LEVEL


def true_velocity(t):
    """A weaving drone at 1.5 m/s."""
    return np.array([1.5 * np.cos(0.5 * np.sin(0.4 * t)), 1.5 * np.sin(0.5 * np.sin(0.4 * t)), 0.0])


def fly(
    wrong, seconds=20.0, noise=0.2, scale=1.05, sees=lambda t: True, seed=4, turn=0.0, yaw=0.006
):
    """Fly with telemetry at 50 Hz and a tick and a picture each 0.1 s.

    wrong(t): (3,) m/s that velocity and position are off. noise: m/s, 1 σ of each flow's error.
    scale: of the flow, by a wrong height. sees(t): whether the picture shows
    ground. turn: rad, that the told heading is wrong. yaw: rad, 1 σ of it as told. Return times
    (T,), the errors (T,2) m/s of the velocity that is used, and (T,2) m of the place, both in the
    frame of what is seen, and what was made of the last picture.
    """
    rng, frame, ground = np.random.default_rng(seed), OdometryFrame(), VelocityFromGround()
    place, slid = np.zeros(3), np.zeros(3)
    doubt = OwnDoubt(yaw=yaw)
    states, found, before, shown = {}, [], 0.0, np.zeros(3)
    for k in range(1, round(seconds * 50) + 1):
        t = k / 50
        v = true_velocity(t)
        place, slid = place + v / 50, slid + wrong(t) / 50
        told = LocalPosition(t, place + slid, v + wrong(t) + rng.normal(0.0, 0.03, 3))
        (local,) = frame.localised([told], 0.05)
        states[k] = VehicleState(t, local.p, local.v, LEVEL, np.zeros(3))
        v, seen = turned(v, turn), turned(place, turn)
        found.append((t, *(local.v - v)[:2], *(local.p - seen)[:2]))
        if k % 5:
            continue
        off = noise * rng.normal(size=2)
        if before and sees(t):
            way = scale * turned(place - shown, turn)[:2] + 0.1 * off
            flow = GroundFlow(before, t, way, HEIGHT.value)
            ground.see(flow, states[k - 5], states[k], HEIGHT, doubt)
        before, shown = t, place
        frame.by_sight = ground.decide(t, states[k].v, doubt)
    rows = np.array(found)
    return rows[:, 0], rows[:, 1:3], rows[:, 3:], frame.by_sight


def slide(size, begin=5.0, end=12.0):
    """A velocity that goes wrong at once, and is right again."""
    return lambda t: np.array([0.0, size, 0.0]) if begin <= t < end else np.zeros(3)


def turned(v, angle):
    """Return a vector (3,) turned left by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def rms(errors):
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_velocity_is_corrected_within_a_second_and_let_go_again(seed):
    t, v, *_ = fly(slide(0.8), seed=seed)
    assert rms(v[(t > 6.0) & (t < 12.0)]) < 0.3
    assert np.abs(v[(t > 5.95) & (t < 6.05), 1]).mean() < 0.4
    assert rms(v[t > 14.0]) < 0.15
    assert rms(v[t > 16.0]) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_a_right_velocity_is_left_alone(seed):
    _, v, p, _ = fly(lambda t: np.zeros(3), seconds=60.0, seed=seed)
    _, alone, *_ = fly(lambda t: np.zeros(3), seconds=60.0, sees=lambda t: False, seed=seed)
    assert rms(v - alone) < 0.05
    assert np.linalg.norm(p[250:] - p[:-250], axis=1).max() < 0.3  # within five seconds


def test_what_is_seen_stays_where_it_is_in_odometry():
    t, _, p, _ = fly(slide(0.8))
    moved = np.linalg.norm(p[np.searchsorted(t, 11.9)] - p[np.searchsorted(t, 5.0)])
    assert moved < 1.9  # of 5.5 m


def test_a_camera_that_sees_no_ground_any_more_lets_the_correction_fade():
    t, v, *_ = fly(slide(0.8, end=40.0), seconds=30.0, sees=lambda t: t < 8.0)
    assert abs(v[np.searchsorted(t, 8.2), 1]) < 0.4
    assert v[-1, 1] == pytest.approx(0.8, abs=0.15)


def test_nothing_is_corrected_before_a_picture_came():
    v = np.array([1.0, -0.5, 0.2])
    by_sight = VelocityFromGround().decide(3.0, v, OwnDoubt(velocity=0.1, yaw=0.05))
    assert by_sight.corrected(v) == pytest.approx(v)
    assert by_sight.turn_sigma == pytest.approx(0.05)
    assert by_sight.sigma == pytest.approx(np.hypot(0.1, 0.05 * np.hypot(1.0, 0.5)))


def test_a_correction_is_taken_back():
    made = VelocityBySight(turn=0.3, error=np.array([0.2, -0.1, 0.0]))
    v = np.array([1.0, -0.5, 0.2])
    assert made.told(made.corrected(v)) == pytest.approx(v)
    assert VelocityBySight(turn=np.pi / 2).corrected(v) == pytest.approx([0.5, 1.0, 0.2])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degrees", [-5.0, -2.0, 0.0, 5.0])
def test_a_wrong_heading_is_found_to_its_doubt(degrees, seed):
    turn = np.radians(degrees)
    *_, made = fly(lambda t: np.zeros(3), seconds=40.0, turn=turn, yaw=0.05, seed=seed)
    assert made.turn_sigma < np.radians(1.5)
    assert abs(made.turn - turn) < 3.0 * made.turn_sigma


@pytest.mark.parametrize("degrees", [5.0, 20.0])
def test_what_is_seen_stays_where_it_is_with_a_wrong_heading(degrees):
    *_, alone, _ = fly(lambda t: np.zeros(3), turn=np.radians(degrees), sees=lambda t: False)
    *_, p, _ = fly(lambda t: np.zeros(3), turn=np.radians(degrees), yaw=0.05)
    assert np.linalg.norm(p[-1] - p[-200]) < 0.3 * np.linalg.norm(alone[-1] - alone[-200])


def flow_as_it_looks(t, v, rate, lean, rng):
    """The flow from `t` on, of ground before a camera; told attitudes lean by `lean` (2,) rad.

    The drone turns at `rate` [rad/s]; lean: about its axes ahead and to the left.
    """
    yaws = rate * t, rate * (t + 0.1)
    off, away = rng.uniform(-1.3, 1.3, 60), 5.0 * np.sqrt(rng.random(60))
    ground = np.column_stack([away * np.cos(off + yaws[0]), away * np.sin(off + yaws[0])])
    rays = []
    for k, yaw in enumerate(yaws):
        points = np.column_stack([ground - 0.1 * k * v[:2], np.full(60, -HEIGHT.value)])
        seen = points @ rotation_matrix(quaternion_from_euler(0.0, 0.0, yaw))  # in the body
        told = rotation_matrix(quaternion_from_euler(*lean, yaw))
        rays.append(seen @ told.T / np.linalg.norm(points, axis=1)[:, None])
    way = way_over_ground(*rays, HEIGHT.value, HEIGHT.value)
    return None if way is None else GroundFlow(t, t + 0.1, way, HEIGHT.value)


@pytest.mark.parametrize("lean", [[0.05, 0.0], [0.0, -0.05], [-0.035, 0.035]])
@pytest.mark.parametrize("rate", [2.0, -1.0])
def test_an_attitude_that_leans_moves_the_velocity_little_while_the_drone_turns(lean, rate):
    ground, v, rng = VelocityFromGround(), np.array([0.3, 0.0, 0.0]), np.random.default_rng(3)
    doubt = OwnDoubt(velocity=0.15, tilt=0.025, yaw=0.05)
    errors, shown = [], []
    for k in range(150):
        t = 0.1 * k
        flow = flow_as_it_looks(t, v, rate, lean, rng)
        if flow is not None:
            states = [
                VehicleState(s, np.zeros(3), v, quaternion_from_euler(*lean, rate * s), np.zeros(3))
                for s in (t, t + 0.1)
            ]
            ground.see(flow, *states, HEIGHT, doubt)
            shown.append(np.linalg.norm(flow.way / 0.1 - v[:2]))
        errors.append(np.linalg.norm(ground.decide(t + 0.1, v, doubt).corrected(v) - v))
    assert np.mean(shown) > 0.05 * abs(rate)  # so wrong is what the ground shows
    assert np.mean(errors[50:]) < 0.12
