from dataclasses import replace

import numpy as np
import pytest

from companion.control.formulation import Formulation, position_velocity_sigma, widened
from companion.control.nmpc import NmpcConfig
from companion.estimation.prediction import Prediction
from companion.guidance.fence import FenceConfig
from companion.guidance.guidance import Reference
from companion.guidance.mission import MissionProgress
from companion.model import HOVER
from companion.types import Obstacles
from tests.companion.tracks import OWN, track


def test_the_doubt_of_a_neighbour_out_of_sight_claims_free_room_only():
    seen = track(1, [1.0, 0, 0])
    assert np.allclose(position_velocity_sigma(OWN, seen, 0.8, 4.0), 1.0)
    assert np.allclose(position_velocity_sigma(OWN, replace(seen, unseen=0.6), 0.8, 4.0), 0.2)
    assert position_velocity_sigma(OWN, replace(seen, unseen=0.6), 1.1, 4.0) == (0.0, 0.0)
    below = replace(track(1, [0.3, 0, -1.0]), unseen=0.6)  # (37) sees it 0.5 m away
    assert np.allclose(position_velocity_sigma(OWN, below, 0.4, 2.5), 0.1)


def obstacles(cylinders, sigmas):
    places = np.array(cylinders).reshape(-1, 3)
    return Obstacles(places, np.zeros((0, 4)), np.zeros((0, 3)), np.array(sigmas))


def test_doubt_of_a_trunk_widens_it_and_never_takes_room_that_is_in_use():
    far, sure = [5.0, 0.0, 1.0], [-5.0, 0.0, 1.0]
    wide = widened(obstacles([far, sure], [0.4, 0.05]), OWN.p, 1.0, 0.6)
    assert wide[:, 2] == pytest.approx([1.28, 1.0])
    at_it = widened(obstacles([[1.7, 0.0, 1.0]], [0.4]), OWN.p, 1.0, 0.6)  # 0.1 m beyond (38)
    assert at_it[0, 2] == pytest.approx(1.1)
    hopeless = widened(obstacles([far], [50.0]), OWN.p, 1.0, 0.6)
    assert hopeless[0, 2] < 1.5


def test_doubt_does_not_close_the_way_between_two_trunks():
    pair = obstacles([[6.0, 1.2, 0.3], [6.0, -1.2, 0.3]], [0.6, 0.6])  # 1.8 m apart, 1.2 m kept
    wide = widened(pair, OWN.p, 1.0, 0.6)
    assert 2.4 - wide[:, 2].sum() >= 1.2 + 0.29


def reference(land):
    """Hover at the last goal."""
    return Reference(
        MissionProgress(OWN.p, 0, True),
        OWN.p,
        OWN.p,
        (),
        0.0,
        1.0,
        "",
        1.8,
        [],
        [],
        frozenset(),
        obstacles([], []),
        land,
    )


def test_a_neighbour_flies_on_as_it_did_eq_14():
    formulation = Formulation(NmpcConfig(), FenceConfig())
    met = track(1, [2.0, 0.2, 0.0], [-1.0, 0.1, 0.0])
    ahead = Prediction(np.r_[OWN.p, OWN.v, OWN.q_wb], HOVER, np.zeros(3), 0.2)
    instance = formulation.instance(OWN, replace(reference(False), near=[(met, 1.0)]), ahead)
    assert instance.neighbour_p[0] == pytest.approx([1.8, 0.22, 0.0])
    assert instance.neighbour_v[0].tolist() == [-1.0, 0.1, 0.0]


def test_a_drone_that_lands_has_no_floor():
    """It is below the flying height then, from where plans are hard to make and not flown."""
    formulation = Formulation(NmpcConfig(), FenceConfig())
    ahead = Prediction(np.r_[OWN.p, OWN.v, OWN.q_wb], HOVER, np.zeros(3), 0.0)
    for land, floors in ((False, 1), (True, 0)):
        instance = formulation.instance(OWN, reference(land), ahead)
        planes = instance.planes[instance.plane_active > 0]
        assert (planes[:, 2] < -0.5).sum() == floors
        assert (planes[:, 2] > 0.5).sum() == 1
