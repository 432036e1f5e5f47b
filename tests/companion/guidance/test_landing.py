"""Nobody lands on one who flies below."""

import numpy as np
import pytest

from companion.guidance.gaze import Gaze, GazeConfig
from companion.guidance.landing import Landing
from companion.guidance.mission import Mission, MissionConfig
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
GOAL = [0.0, 0.0, 1.3]


def at(time):
    return VehicleState(time, np.array(GOAL), np.zeros(3), LEVEL, np.zeros(3))


def track(*p):
    return Track(1, np.array(p), np.zeros(3), np.eye(6), age=1.0, unseen=0.0)


def lands_at(config, seen_at, **keys):
    """Time [s] at which it lands; seen_at: tracks known at a time."""
    look = GazeConfig(**keys)
    landing = Landing(MissionConfig(goals=[GOAL], **config), 0.5, turns=look.survey > 0.0)
    gaze = Gaze(look)
    mission = Mission(MissionConfig(goals=[GOAL]))
    assert mission.update(at(0.0)).complete
    for tick in range(300):
        time = tick / 10
        gaze.update(time, np.zeros(3), np.zeros(3), 0.0)
        # Looking round at the goal is no looking round before setting out: it stays where it is.
        assert mission.update(at(time), gaze.surveyed).goal == pytest.approx(GOAL)
        step = landing.update(at(time), seen_at(time), gaze.surveyed)
        if step.look_round:
            gaze.look_round()
        if step.land:
            return time
    return None


def nobody(time):
    return []


def test_without_a_wait_it_lands_at_once():
    assert lands_at({}, lambda time: [track(0.1, 0.0, 0.6)]) == 0.0
    assert lands_at({"land": False, "land_wait": 10.0}, nobody) == 0.0


def test_first_it_looks_once_all_round():
    turn = 2 * np.pi / GazeConfig().slew
    assert lands_at({"land_wait": 10.0}, nobody) == pytest.approx(turn, abs=0.2)


@pytest.mark.parametrize(("p", "waits"), [((0.3, 0.3, 0.6), True), ((0.3, 0.3, 1.5), False),
                                          ((0.4, 0.4, 0.6), False)])  # fmt: skip
def test_it_waits_for_who_is_below(p, waits):
    landed = lands_at({"land_wait": 20.0}, lambda time: [track(*p)] if time < 7.0 else [], survey=0)
    assert landed == (7.0 if waits else 0.0)


def test_it_does_not_wait_for_ever():
    assert lands_at({"land_wait": 5.0}, lambda time: [track(0.0, 0.0, 0.6)]) == 5.0


def test_a_clock_that_begins_anew_does_not_keep_it_up():
    landing = Landing(MissionConfig(goals=[GOAL], land_wait=10.0), 0.5, turns=True)
    below = [track(0.0, 0.0, 0.6)]
    assert not landing.update(at(900.0), below, surveyed=True).land
    assert landing.update(at(1.0), below, surveyed=True).land
