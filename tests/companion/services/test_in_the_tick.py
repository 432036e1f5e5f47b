"""Ground stations' requests through a whole companion: goals, hold, return, land, refusals."""

import numpy as np
import pytest

from companion.pipeline import Companion
from companion.settings.config import CompanionConfig
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    CommandAck,
    Heartbeat,
    LocalPosition,
    MissionAck,
    MissionCount,
    MissionItem,
    Received,
    Source,
)
from mavlink_bridge.wire.video import Frame

VEHICLE, GROUND = Source(1, 1), Source(255, 190)
EMPTY = {"neighbours": np.zeros((0, 6)), "trunks": np.zeros((0, 6))}
PLACE, LEVEL = np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0])


class Drone:
    """A companion that a pilot handed a hovering vehicle; it stays where it is."""

    def __init__(self):
        config = CompanionConfig.model_validate(
            {
                "fileversion": 2,
                "mission": {"goals": [[4.5, 0.0, 2.0]], "land": False},
                "sensing": {"neighbours": "truth", "obstacles": "map"},
                "camera": {"width": 64, "height": 64},
                "gaze": {"survey": 0.0},
                "fence": {"east": [-20, 20], "north": [-20, 20]},
                "airframe": {"hover_doubt": 0.04},
            }
        )
        self.companion, self.k = Companion(config, lambda: 0.0), 0
        while self.k < 20:
            tick = self.tick("hold" if self.k < 10 else "offboard")
        assert tick.supervised.phase is Phase.FLY

    def tick(self, mode="offboard", *ground, armed=True):
        now, self.k = 10.0 + self.k / 10, self.k + 1
        heard = [Received(VEHICLE, Heartbeat(12, 2, armed, MODES[mode], 4))]
        heard += [Received(GROUND, m) for m in ground]
        for t in now - 0.08 + 0.02 * np.arange(5):
            heard.append(Received(VEHICLE, Attitude(t, LEVEL, np.zeros(3))))
            heard.append(Received(VEHICLE, LocalPosition(t, PLACE, np.zeros(3))))
        return self.companion.tick(TickInputs(now, heard, Frame(now - 0.03, EMPTY)))


def replies(tick, kind):
    return [m for m in tick.served.messages if isinstance(m, kind)]


def test_uploaded_goals_are_flown_to_at_once():
    drone = Drone()
    assert drone.tick().reference.progress.goal[0] > 4.0
    drone.tick("offboard", MissionCount(1, 191, 1))
    north = MissionItem(1, 191, 0, 4, 16, 0, 1, (0.0,) * 4, 0.0, 6.0 / 1e3, 2.0)
    tick = drone.tick("offboard", north)
    assert replies(tick, MissionAck) == [MissionAck(255, 190, 0)]
    np.testing.assert_allclose(tick.reference.progress.goal, [0.0, 6.0, 2.0], atol=1e-3)


@pytest.mark.parametrize(
    ("number", "mode"), [(193, "hold"), (20, "rtl"), (21, "land")], ids=["hold", "return", "land"]
)
def test_control_is_given_back_as_asked_and_the_stream_ends_with_the_mode(number, mode):
    drone = Drone()
    tick = drone.tick("offboard", Command(number, (0.0,) * 7, 1, 191))
    assert replies(tick, CommandAck) == [CommandAck(number, 0, 255, 190)]
    wanted = (1.0, MODES[mode] >> 16 & 0xFF, MODES[mode] >> 24 & 0xFF)
    assert [m.params[:3] for m in tick.supervised.requests if m.command == 176] == [wanted]
    assert tick.setpoint is not None
    tick = drone.tick(mode)
    assert (tick.supervised.phase, tick.setpoint) == (Phase.PASSIVE, None)
    tick = drone.tick(mode, Command(number, (0.0,) * 7, 1, 191))
    assert replies(tick, CommandAck) == [CommandAck(number, 1, 255, 190)]


CONTINUE = Command(193, (1.0, *(0.0,) * 6), 1, 191)


def test_a_companion_told_to_resume_flies_on_once_the_mode_is_changed_again():
    """Its mission goes on where it was; the companion itself asks for nothing."""
    drone = Drone()
    drone.tick("hold")
    assert [drone.tick("hold").supervised.phase for _ in range(5)] == [Phase.PASSIVE] * 5
    tick = drone.tick("hold", CONTINUE)
    assert replies(tick, CommandAck) == [CommandAck(193, 0, 255, 190)]
    ticks = [drone.tick("hold") for _ in range(15)]
    assert ticks[-1].supervised.phase is Phase.ENGAGE
    assert ticks[-1].setpoint is not None  # which the vehicle ignores in hold
    asked = [m for t in (tick, *ticks) for m in t.supervised.requests]
    assert not [m for m in asked if isinstance(m, Command) and m.command != 511]
    tick = [drone.tick("offboard") for _ in range(3)][-1]
    assert tick.supervised.phase is Phase.FLY
    np.testing.assert_allclose(tick.reference.progress.goal, [4.5, 0.0, 2.0])


def test_a_vehicle_that_is_in_offboard_without_it_is_not_retaken():
    drone = Drone()
    drone.tick("hold")
    drone.tick("offboard")  # another program's
    drone.tick("offboard", CONTINUE)
    ticks = [drone.tick("offboard") for _ in range(15)]
    assert {(t.supervised.phase, t.setpoint) for t in ticks} == {(Phase.WAIT, None)}
    assert "a pilot must choose another mode" in ticks[-1].supervised.inhibit_reason


def test_a_vehicle_disarmed_in_flight_is_let_go_in_that_tick():
    drone = Drone()
    tick = drone.tick("offboard", armed=False)
    assert (tick.supervised.phase, tick.setpoint) == (Phase.PASSIVE, None)
    assert tick.supervised.requests == []


def test_a_refusal_of_what_the_tick_before_asked_is_told():
    drone = Drone()
    drone.tick("offboard", Command(21, (0.0,) * 7, 1, 191))
    now = 10.0 + drone.k / 10
    refused = Received(VEHICLE, CommandAck(176, 1, 1, 191))
    tick = drone.companion.tick(TickInputs(now, [refused], None))
    assert tick.vehicle.refusals == ("mode land: temporarily rejected",)
