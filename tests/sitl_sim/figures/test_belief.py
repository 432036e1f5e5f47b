"""Beliefs of the companions in the world's frame."""

import numpy as np
import pytest

from sitl_sim.figures.belief import Beliefs
from sitl_sim.recording.run_folder import load_run
from tests.sitl_sim import flights


def test_a_belief_agrees_with_the_truth_in_the_worlds_frame(folder):
    run = load_run(folder)
    beliefs = Beliefs(run)
    belief = beliefs.at(0, 8.0)
    truth = beliefs.positions(8.0)
    np.testing.assert_allclose(belief.plan[0], truth[0], atol=0.11)
    np.testing.assert_allclose(belief.plan[-1] - belief.plan[0], [2.0, 0.0, 0.0], atol=1e-6)
    assert belief.critical[0].drone == 1
    np.testing.assert_allclose(belief.tracks, truth[1:], atol=0.11)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))
