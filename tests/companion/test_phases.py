"""When the companion takes control, and how it gives it back."""

import numpy as np
import pytest

from companion.mission import MissionConfig
from companion.phases import Phase, Phases
from mavlink_bridge.ardupilot import MODES as ARDUPILOT
from mavlink_bridge.ardupilot import ArduPilot
from mavlink_bridge.messages import Heartbeat, VehicleState
from mavlink_bridge.px4 import MODES as PX4
from mavlink_bridge.px4 import Px4


def at(height):
    return VehicleState(
        0.0, np.array([0.0, 0.0, height]), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3)
    )


class Flown:
    """A state machine, tick by tick, with a pilot at the other end."""

    def __init__(self, adapter, modes, **mission):
        self.phases = Phases(MissionConfig(**mission), adapter)
        self.modes, self.kind, self.time = modes, adapter.autopilot, 0.0

    def tick(self, mode, *, armed=True, height=0.0):
        self.time += 0.1
        heartbeat = Heartbeat(self.kind, 2, armed, self.modes[mode], 4)
        return self.phases.update(self.time, heartbeat, at(height), True, False)


def test_px4_is_engaged_in_hold_and_flown_in_offboard():
    flown = Flown(Px4(1), PX4)
    assert flown.tick("hold", armed=False).phase is Phase.WAIT
    engaged = flown.tick("hold")
    assert (engaged.phase, engaged.stream) == (Phase.ENGAGE, True)
    assert flown.tick("takeoff").phase is Phase.ENGAGE
    assert flown.tick("offboard", height=2.0).phase is Phase.FLY


def test_ardupilot_is_left_alone_until_it_is_up():
    flown = Flown(ArduPilot(1), ARDUPILOT)
    flown.tick("offboard", armed=False, height=7.0)  # where it stands is 7 m up in its frame
    for height in (7.0, 7.0, 7.5, 8.0):
        decision = flown.tick("offboard", height=height)
        assert (decision.phase, decision.stream) == (Phase.WAIT, False)
    assert flown.tick("hold", height=9.0).phase is Phase.WAIT
    assert flown.tick("offboard", height=9.0).phase is Phase.ENGAGE
    assert flown.tick("offboard", height=9.0).phase is Phase.FLY


@pytest.mark.parametrize(("adapter", "modes"), [(Px4(1), PX4), (ArduPilot(1), ARDUPILOT)])
def test_control_is_given_back(adapter, modes):
    flown = Flown(adapter, modes)
    for mode in ("hold", "offboard", "offboard", "offboard"):
        flown.tick(mode, height=3.0)
    assert flown.phases.phase is Phase.FLY
    flown.phases.release()
    asked = flown.tick("offboard", height=3.0)
    assert asked.stream  # until the vehicle shows that it holds by itself
    assert asked.requests == adapter.hold()
    ended = flown.tick("hold", height=3.0)
    assert (ended.phase, ended.stream, ended.requests) == (Phase.PASSIVE, False, [])
    assert flown.tick("offboard", height=3.0).phase is Phase.PASSIVE


def test_nothing_to_give_back():
    flown = Flown(Px4(1), PX4)
    flown.tick("offboard", armed=False)
    flown.phases.release()
    decision = flown.tick("offboard")  # somebody else's offboard
    assert (decision.phase, decision.stream, decision.requests) == (Phase.PASSIVE, False, [])
