from dataclasses import replace

import numpy as np

from companion.control.formulation import position_velocity_sigma
from tests.companion.tracks import OWN, track


def test_the_doubt_of_a_neighbour_out_of_sight_claims_free_room_only():
    seen = track(1, [1.0, 0, 0])
    assert np.allclose(position_velocity_sigma(OWN, seen, 0.8, 4.0), 1.0)
    assert np.allclose(position_velocity_sigma(OWN, replace(seen, unseen=0.6), 0.8, 4.0), 0.2)
    assert position_velocity_sigma(OWN, replace(seen, unseen=0.6), 1.1, 4.0) == (0.0, 0.0)
    below = replace(track(1, [0.3, 0, -1.0]), unseen=0.6)  # (37) sees it 0.5 m away
    assert np.allclose(position_velocity_sigma(OWN, below, 0.4, 2.5), 0.1)
