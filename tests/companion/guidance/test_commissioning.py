"""The moves of a commissioning flight: small, about all axes, and over after half a minute."""

from dataclasses import replace

import numpy as np

from companion.estimation.delay import Delay
from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.commissioning import DURATION, Commissioning
from companion.guidance.guidance import Guidance
from companion.perception.camera_health import CameraFault
from companion.settings.config import CompanionConfig
from companion.types import Phase
from tests.companion.depth_images import state

OWN = state([3.0, -2.0, 2.5])
SOON = Delay(0.06, 0.003)
TIMES = np.arange(0.0, DURATION + 1.0, 0.1)


def test_the_moves_stay_near_and_end_where_they_began():
    moves = Commissioning()
    made = [moves.update(replace(OWN, time=100.0 + t)) for t in TIMES]
    offsets = np.array([m.goal for m in made]) - OWN.p
    assert np.abs(offsets).max() < 1.0
    assert (np.ptp(offsets, axis=0) > 0.6).all()
    np.testing.assert_allclose(offsets[-1], 0.0)
    assert [m.complete for m in made] == [t > DURATION for t in 100.0 + TIMES - 100.0]
    assert 25.0 < DURATION < 35.0
    yaws = np.array([moves.yaw(100.0 + t) for t in TIMES])
    assert np.ptp(yaws) > 1.4
    assert np.abs(np.diff(yaws)).max() < 0.2  # rad from tick to tick


def test_guidance_flies_the_moves_and_takes_no_other_goals():
    config = CompanionConfig.model_validate(
        {"mission": {"commission": True}, "log": {"path": "flight.mcap"}}
    )
    guidance = Guidance(config.guidance())
    guidance.set_goals([np.array([50.0, 0.0, 2.0])])
    known = KnownObstacles()
    for t in TIMES:
        own = replace(OWN, time=t)
        reference = guidance.decide(own, [], known, CameraFault.NONE, Phase.FLY, delay=SOON)
        assert np.linalg.norm(reference.target - OWN.p) < 1.4
        assert reference.speed_limit != "visibility"
    assert reference.land
