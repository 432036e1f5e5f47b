"""What the certificate is told: neighbours, trunks, fence and ground as they are known."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.fence import FenceConfig
from companion.perception.camera_health import CameraFault
from companion.perception.config import CameraConfig
from companion.perception.frontend import Detections
from companion.perception.view import View, load_camera
from companion.supervision.certify import CertificateConfig
from companion.supervision.surroundings import SurroundingsEstimator, neighbour_rows
from companion.types import Phase, Track
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
OWN = VehicleState(1.0, np.array([0.0, 0.0, 2.0]), np.zeros(3), LEVEL, np.zeros(3))
SEEN = Detections(time=1.0, own=OWN, started=True)
NOTHING = KnownObstacles()


@pytest.fixture(scope="module")
def view():
    return View(load_camera(CameraConfig()), needs_foot=False)


def track(p, unseen=0.1, covariance=None, v=(0.5, 0.0, 0.0)):
    p_v = np.diag([0.01] * 3 + [0.04] * 3) if covariance is None else covariance
    return Track(7, np.array(p, float), np.array(v), p_v, age=2.0, unseen=unseen)


def around(view, tracks=(), known=NOTHING, seen=SEEN, phase=Phase.FLY, own=OWN, offset=(0, 0, 0)):
    estimator = SurroundingsEstimator(CertificateConfig(), FenceConfig(), view)
    return estimator.update(
        1.0, own, seen, known, list(tracks), np.array(offset, float), phase
    ).scene()


def test_the_doubt_of_a_neighbour_is_the_largest_along_any_axis():
    covariance = np.diag([0.01, 0.01, 0.25, 0.04, 0.36, 0.04])
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    both = np.kron(np.eye(2), turn)
    (row,) = neighbour_rows([track((1, 2, 3), covariance=both @ covariance @ both.T)], [False])
    assert row[:6] == pytest.approx([1, 2, 3, 0.5, 0, 0])
    assert row[[6, 8]] == pytest.approx([0.25, 0.36])
    # No direction and no time later is less sure than it says.
    for t in (0.0, 0.5, 1.6):
        g = np.hstack([np.eye(3), t * np.eye(3)])
        spread = np.linalg.eigvalsh(g @ both @ covariance @ both.T @ g.T)[-1]
        assert row[6] + 2 * t * row[7] + t * t * row[8] >= spread - 1e-12


@pytest.mark.parametrize(
    ("place", "unseen", "out"),
    [
        ((3.0, 0.0, 2.0), 0.1, 0.0),
        ((3.0, 0.0, 2.0), 1.0, 0.0),  # lost in plain view: it may be anywhere
        ((3.0, 0.0, 2.0), 1.1, 1.0),  # where it was remembered, and is not
        ((-3.0, 0.0, 2.0), 0.2, 0.0),
        ((-3.0, 0.0, 2.0), 1.0, 1.0),
        ((3.0, 2.0, 2.0), 1.0, 1.0),  # behind the trunk
    ],
)
def test_a_neighbour_is_out_of_view_where_the_camera_or_a_trunk_hides_it(view, place, unseen, out):
    trunk = KnownObstacles(occluders=np.array([[1.5, 1.0, 0.3]]))
    (row,) = around(view, [track(place, unseen)], trunk).neighbours
    assert row[9:].tolist() == [unseen, out]


def test_who_was_out_of_view_stays_remembered_while_no_picture_is_searched(view):
    estimator = SurroundingsEstimator(CertificateConfig(), FenceConfig(), view)
    behind = track((-3.0, 0.0, 2.0), 0.7)
    back = replace(OWN, q_wb=np.array([0.0, 0.0, 0.0, 1.0]))  # turned towards it
    frozen = replace(SEEN, fault=CameraFault.FROZEN)

    def out(own, seen):
        zero = np.zeros(3)
        around = estimator.update(1.0, own, seen, NOTHING, [behind], zero, Phase.FLY)
        return around.scene().neighbours[0, 10]

    assert out(OWN, SEEN) == 1.0
    assert out(back, frozen) == 1.0
    assert out(back, replace(SEEN, own=back)) == 0.0  # a picture shows that it is not there
    estimator.reset()
    assert out(back, frozen) == 0.0  # nothing was ever out of view


def test_trunks_have_their_doubt_and_stand(view):
    known = KnownObstacles(
        np.array([[3.0, 1.0, 0.4]]), np.array([[2.0, 0.0, 1.0]]), sigmas=np.array([0.2])
    )
    scene = around(view, known=known)
    assert scene.cylinders.tolist() == [[3.0, 1.0, 0.4, 0.2, 0.0, 0.0]]
    assert scene.points.tolist() == [[2.0, 0.0, 1.0]]
    unsure = replace(known, sigmas=np.zeros(0))
    assert around(view, known=unsure).cylinders[0, 3] == 0.0


def test_the_fence_lies_where_the_map_says_and_the_ground_counts_in_flight_alone(view):
    fence = FenceConfig()
    before, moved = around(view).planes, around(view, offset=(1.0, 0.0, 0.0)).planes
    assert moved[:, 3] == pytest.approx(before[:, 3] - before[:, 0])
    climbing = around(view, phase=Phase.TAKEOFF).planes
    assert before[:-1].tolist() == climbing.tolist()
    assert before[-1] == pytest.approx([0.0, 0.0, -1.0, -fence.altitude_min])


def test_space_is_seen_only_by_a_camera_that_is_sound(view):
    assert around(view).free[0] == CertificateConfig().seen_range
    assert not around(view, seen=replace(SEEN, fault=CameraFault.FROZEN)).free.any()


def test_without_an_own_state_nothing_is_known(view):
    scene = around(view, [track((3.0, 0.0, 2.0))], own=None)
    assert not len(scene.neighbours)
    assert not len(scene.planes)
    assert not scene.free.any()
