"""What goes out where supervision itself fails."""

import numpy as np
import pytest

from companion.supervision.guard import AutopilotRequest, Reason
from companion.supervision.last_resort import LastResort
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import MODES, Px4
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import Heartbeat


def beat(mode):
    return Heartbeat(12, 2, True, MODES[mode], 4)


@pytest.mark.parametrize("phase", [Phase.ENGAGE, Phase.FLY, Phase.LAND])
@pytest.mark.parametrize("heartbeat", [None, beat("offboard")])
def test_a_vehicle_that_follows_is_levelled_and_asked_to_hold(phase, heartbeat):
    s = LastResort(Px4(1)).decide(5.0, phase, heartbeat, "supervise: x")
    assert (s.phase, s.requests, s.inhibit_reason) == (phase, Px4(1).hold(), "supervise: x")
    assert s.verdict is not None
    assert (s.verdict.reason, s.verdict.request) == (Reason.FAILURE, AutopilotRequest.HOLD)
    assert s.verdict.bad_ticks == 0
    assert s.command is not None
    assert s.command.c == GRAVITY
    assert (s.command.omega == np.zeros(3)).all()


@pytest.mark.parametrize(
    ("phase", "heartbeat"),
    [(phase, beat("offboard")) for phase in Phase if not phase.flying]
    + [(Phase.FLY, beat("hold")), (Phase.LAND, beat("land")), (Phase.PASSIVE, None)],
)
def test_a_vehicle_that_does_not_follow_is_left_alone(phase, heartbeat):
    s = LastResort(Px4(1)).decide(5.0, phase, heartbeat, "supervise: x")
    assert (s.phase, s.requests, s.command) == (Phase.PASSIVE, [], None)
    assert s.inhibit_reason == "supervise: x"


def test_the_request_is_repeated_until_a_heartbeat_shows_it():
    last = LastResort(Px4(1))
    times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    asked = [last.decide(t, Phase.FLY, beat("offboard"), "x").requests for t in times]
    hold = Px4(1).hold()
    assert asked == [hold, [], [], hold, [], [], hold]
