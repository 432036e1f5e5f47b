"""Clear share: what share of the last finds was clear."""

import numpy as np
import pytest

from companion.estimation.clear_share import ClearShare
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.camera import Camera
from companion.perception.frontend import Detections
from companion.perception.view import View
from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState


def finds(clear, unclear):
    """Return so many finds at 4 m whose range is known to a fifth, and to three tenths."""
    ahead = np.array([0.0, 0.0, 1.0])
    return [Detection(ahead, 4.0, 0.02, 4.0 * s) for s in clear * [0.2] + unclear * [0.3]]


def test_without_finds_nothing_is_unclear():
    share = ClearShare(0.25)
    assert share.value == 1.0
    share.update(0.0, [])
    assert share.value == 1.0


def test_a_few_unclear_finds_tell_nothing_and_many_tell_all():
    """Ten clear ones are taken for granted."""
    share = ClearShare(0.25)
    share.update(0.0, finds(0, 5))
    assert share.value == pytest.approx(10 / 15)
    for k in range(60):
        share.update(0.1 * k, finds(1, 3))
    assert share.value == pytest.approx((60 + 10) / (240 + 5 + 10))


@pytest.mark.parametrize(
    ("later", "more", "value"),
    [(10.0, 60, 70 / 110), (10.1, 60, 1.0), (10.1, 59, 69 / 109), (900.0, 0, 10 / 50)],
)
def test_finds_count_for_ten_seconds_and_until_sixty_others_are_found(later, more, value):
    share = ClearShare(0.25)
    share.update(0.0, finds(0, 40))
    share.update(later, finds(more, 0))
    assert share.value == pytest.approx(value)


def test_pictures_that_showed_nothing_do_not_pile_up():
    share = ClearShare(0.25)
    for k in range(2000):
        share.update(0.1 * k, finds(1, 0) if k < 100 else [])
    assert share.value == 1.0
    assert len(share._pictures) <= 100
    share.update(200.0, finds(0, 60))
    assert share.value == pytest.approx(10 / 70)
    assert len(share._pictures) == 1


@pytest.mark.parametrize(("partly", "value"), [(False, 10 / 70), (True, 1.0)])
def test_pictures_that_are_searched_count(partly, value):
    """Finds where a neighbour was known before tell little of the eyes."""
    view = View(Camera.equidistant(640, 400, 160.0), needs_foot=False)
    neighbours = NeighbourEstimator(view, TrackerConfig())
    still = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
    seen = Detections(0.0, still, finds(0, 60), partly=partly)
    neighbours.update(0.0, seen, KnownObstacles())
    assert neighbours.clear_share == pytest.approx(value)
    neighbours.reset()
    assert neighbours.clear_share == 1.0
