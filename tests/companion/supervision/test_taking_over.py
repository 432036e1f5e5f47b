"""The takeover from a pilot: hover thrust, line of sight and goals."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from companion.model import predict
from companion.pipeline import Companion
from companion.settings.config import CompanionConfig
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import MODES
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import (
    Attitude,
    AttitudeTarget,
    Heartbeat,
    LocalPosition,
    Received,
    Source,
)
from mavlink_bridge.wire.video import Frame

HOVER = 0.33
VEHICLE = Source(1, 1)
EMPTY = {"neighbours": np.zeros((0, 6)), "trunks": np.zeros((0, 6))}
GROUND, CLIMB = 10.0, 4.0  # s: armed on the ground in hold, then up to 2 m by the pilot
TAKEN = GROUND + CLIMB + 2.0  # s: the vehicle follows us


@dataclass
class Seen:
    """What a flight did from the moment on that the vehicle follows."""

    z: list[float] = field(default_factory=list)
    offset: list[float] = field(default_factory=list)
    turn: list[float] = field(default_factory=list)
    hover: list[float] = field(default_factory=list)
    target: list[int] = field(default_factory=list)


def fly(lag, goals, aside=0.0, seconds=4.0, true=HOVER, tells=True):
    """Take over at TAKEN [s], shown by the heartbeat `lag` [s] later; aside: m the pilot moves.

    true: the hover thrust. tells: whether the vehicle sends ATTITUDE_TARGET.
    """
    config = CompanionConfig.model_validate(
        {
            "fileversion": 2,
            "mission": {"goals": goals, "land": False},
            "sensing": {"neighbours": "truth", "obstacles": "map"},
            "camera": {"width": 64, "height": 64},
        }
    )
    companion, seen = Companion(config, lambda: 0.0), Seen()
    x = np.array([0.0, 0, 0, 0, 0, 0, 1, 0, 0, 0])  # looks east; the pilot turns it to the west
    u, queue = None, []
    for k in range(round((TAKEN + seconds) * 10)):
        now = k / 10
        heard = []
        for t in now - 0.08 + 0.02 * np.arange(5):
            if t < TAKEN:
                up = np.clip((t - GROUND) / CLIMB, 0.0, 1.0)
                x[:3], x[5] = [0.0, aside * up, 2.0 * up], 0.5 * (0.0 < up < 1.0)
                x[6], x[9] = np.cos(up * np.pi / 2), np.sin(up * np.pi / 2)
            else:
                while queue and queue[0][0] <= t:
                    u = queue.pop(0)[1]
                x = predict(x, np.array([GRAVITY * u[1] / true, *u[0]]), 0.02)
            rates = np.zeros(3) if t < TAKEN else np.array(u[0])
            state = LocalPosition(t + 10, x[:3].copy(), x[3:6].copy())
            attitude = Attitude(t + 10, x[6:10].copy(), rates)
            heard += [Received(VEHICLE, attitude), Received(VEHICLE, state)]
            if t < TAKEN and tells:
                target = AttitudeTarget(t + 10, x[6:10].copy(), np.zeros(3), true)
                heard.append(Received(VEHICLE, target))
        flown = now - lag >= TAKEN
        mode = MODES["offboard" if flown else "takeoff" if GROUND < now < TAKEN - 2.0 else "hold"]
        heard.append(Received(VEHICLE, Heartbeat(12, 2, now > 1.0, mode, 4)))
        tick = companion.tick(TickInputs(now + 10, heard, Frame(now + 9.97, EMPTY)))
        if tick.setpoint is not None:
            queue.append((now + 0.06, (tick.setpoint.omega, tick.setpoint.thrust)))
        if now >= TAKEN - 1.0 and not tells:
            assert tick.supervised.phase is Phase.WAIT
            assert "hover thrust is known to ±" in tick.supervised.inhibit_reason
        elif now >= TAKEN:
            assert tick.supervised.phase in (Phase.ENGAGE, Phase.FLY)
            yaw = 2 * np.arctan2(x[9], x[6])
            seen.z.append(x[2])
            seen.offset.append(float(np.hypot(x[0], x[1] - aside)))
            seen.turn.append(abs(yaw % (2 * np.pi) - np.pi))
            seen.hover.append(tick.motion.thrust_map.hover_thrust)
            seen.target.append(tick.reference.progress.index)
    return seen


@pytest.mark.parametrize("lag", [0.0, 0.5, 0.9])
def test_the_drone_keeps_its_height_at_the_takeover_after_streaming_for_long(lag):
    seen = fly(lag, [[0.0, 0.0, 2.0]])
    assert min(seen.z) > 1.9
    assert max(seen.z) < 2.1
    assert np.allclose(seen.hover, HOVER, atol=0.02)


@pytest.mark.parametrize("true", [0.2, 0.7])
def test_a_hover_thrust_far_from_the_configured_one_is_learnt_before_the_takeover(true):
    seen = fly(0.5, [[0.0, 0.0, 2.0]], true=true)
    assert min(seen.z) > 1.9
    assert max(seen.z) < 2.1
    assert np.allclose(seen.hover, true, rtol=0.05)


def test_without_a_hover_thrust_there_is_no_takeover_and_the_reason_is_told():
    assert fly(0.5, [[0.0, 0.0, 2.0]], seconds=-0.1, tells=False).z == []


def test_before_its_mission_the_drone_stays_where_the_pilot_has_brought_it():
    seen = fly(0.9, [[0.0, 0.0, 2.0]], aside=3.0, seconds=0.9)
    assert max(seen.offset) < 0.1


def test_over_its_goal_the_drone_looks_on_where_the_pilot_looked():
    assert fly(0.0, [[0.0, 0.0, 2.0]], seconds=0.5).turn[-1] < 0.5


def test_goals_that_the_pilot_passes_are_not_reached():
    goals = [[0.0, 4.0, 1.0], [0.0, 30.0, 2.0]]
    assert not any(fly(0.0, goals, aside=12.0, seconds=1.0).target)
