"""What guidance asks of a plan, by the phase of the flight."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.guidance import Guidance
from companion.perception.camera_health import CameraFault
from companion.settings.config import CompanionConfig
from companion.types import Phase
from tests.companion.depth_images import state

OWN = state([3.0, -2.0, 2.5])


def test_until_it_has_looked_round_a_drone_stays_where_it_is():
    """Taken over among others, two fled from whom they saw into whom they had not seen yet."""
    config = CompanionConfig.model_validate(
        {"mission": {"goals": [[40.0, 0.0, 2.0]]}, "log": {"path": "flight.mcap"}}
    )
    guidance, kept = Guidance(config.guidance()), config.nmpc.d_obstacle_safety
    rooms = []
    for k in range(120):
        pushed = replace(OWN, time=0.1 * k, p=OWN.p + np.array([0.002 * k, 0, 0]))
        reference = guidance.decide(
            pushed, [], KnownObstacles(), CameraFault.NONE, Phase.FLY, delay=Delay(0.06, 0.003)
        )
        rooms.append(len(reference.obstacles.planes))
        for n in reference.obstacles.planes:
            assert n[3] - n[:3] @ OWN.p == pytest.approx(0.3 + kept)
    looking = 10 * config.gaze.survey / config.gaze.slew  # ticks
    assert rooms == sorted(rooms, reverse=True)
    assert rooms.count(4) == pytest.approx(looking, abs=1.0)  # and then it is free
