"""Motion under the own inputs: who learns from what, in which phase, and what is forgotten."""

import numpy as np
import pytest

from companion.estimation.autopilot_thrust import AutopilotThrust
from companion.estimation.delay import Delay, DelayEstimator
from companion.estimation.input_history import SentInput
from companion.estimation.motion import MotionEstimator
from companion.model import HOVER
from companion.types import Phase
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.test_delay import Flight

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ROLLED = np.array([np.cos(0.1), np.sin(0.1), 0.0, 0.0])  # 0.2 rad to the right
NOTHING, CARRIED = AutopilotThrust(), AutopilotThrust(airborne=True)


def motion(**settings):
    """Motion of a vehicle that is configured to hover at 0.4 ± 30 %, 0.06 s late."""
    return MotionEstimator(ThrustMap(0.4), 0.3, 0.06, **settings)


def state(time=0.0, v=(0.0, 0.0, 0.0), q=LEVEL):
    return VehicleState(time, np.zeros(3), np.array(v, float), q, np.zeros(3))


def fly(known, phase, told=CARRIED, ticks=12, q=LEVEL, thrust=None):
    """Stay in place for some ticks of 0.1 s; send an input at each, where `thrust` is given."""
    for tick in range(ticks):
        found = known.update(state(0.1 * tick, q=q), [], told, phase)
        if thrust is not None:
            known.sent(SentInput(0.1 * tick, HOVER, thrust))
    return found


def hovers_at(thrust, tick):
    """The word of an autopilot that holds the vehicle with this thrust."""
    return AutopilotThrust(((0.1 * tick - 0.05, thrust),), airborne=True)


@pytest.mark.parametrize("phase", Phase)
def test_the_motion_is_predicted_where_the_companion_flies(phase):
    found = motion().update(state(), [], NOTHING, phase)
    flies = phase in (Phase.ENGAGE, Phase.FLY, Phase.LAND)
    assert (found.prediction is not None) == flies
    assert found.delay == Delay(0.06, 0.1)


def test_without_a_state_nothing_is_predicted_and_all_else_stays():
    found = motion().update(None, [], NOTHING, Phase.FLY)
    assert found.prediction is None
    assert found.delay == Delay(0.06, 0.1)
    assert found.thrust_map == found.hover.map == ThrustMap(0.4)
    assert found.hover.doubt == pytest.approx(0.3)


def test_the_prediction_is_of_the_time_at_which_the_next_input_acts():
    known = motion()
    known.sent(SentInput(-0.1, np.array([GRAVITY + 1.0, 0.0, 0.0, 0.0]), 0.5))
    found = known.update(state(v=(2.0, 0.0, 0.0)), [], NOTHING, Phase.FLY).prediction
    assert found.delay == 0.06
    assert found.u_last[0] == GRAVITY + 1.0
    assert found.x0[:6] == pytest.approx([0.12, 0.0, 0.5 * 0.06**2, 2.0, 0.0, 0.06])


@pytest.mark.parametrize(("settings", "pull"), [({}, 0.0), ({"drag": 0.3}, -0.6)])
def test_drag_is_known_where_it_is_configured(settings, pull):
    known = motion(**settings)
    for _ in range(2):
        found = known.update(state(v=(2.0, 0.0, 1.0)), [], NOTHING, Phase.FLY)
        assert found.prediction.disturbance == pytest.approx([pull, 0.0, 0.0])
        known.reset()  # drag is no matter of the vehicle's clock


@pytest.mark.parametrize(("settings", "exponent"), [({}, 2.0), ({"curve_known": True}, 1.0)])
def test_the_autopilots_thrust_curve_counts_unless_one_is_configured(settings, exponent):
    told = AutopilotThrust(curve=0.0)
    found = motion(**settings).update(None, [], told, Phase.WAIT)
    assert found.thrust_map.exponent == pytest.approx(exponent)


@pytest.mark.parametrize("phase", Phase)
def test_wind_is_learnt_while_the_autopilot_holds_the_drone_and_is_to_hand_it_over(phase):
    known = motion()
    fly(known, phase, q=ROLLED, ticks=60)
    wind = known.predictor.disturbance
    if phase in (Phase.WAIT, Phase.TAKEOFF, Phase.ENGAGE):
        assert wind == pytest.approx([0.0, GRAVITY * np.tan(0.2), 0.0], abs=0.02)
    else:
        assert not wind.any()


def test_on_the_ground_a_tilt_is_no_wind():
    known = motion()
    fly(known, Phase.WAIT, told=NOTHING, q=ROLLED)
    assert not known.predictor.disturbance.any()


@pytest.mark.parametrize(
    ("phase", "source"),
    [(Phase.FLY, "flight"), (Phase.ENGAGE, "configured"), (Phase.LAND, "configured")],
)
def test_the_own_thrust_tells_the_hover_thrust_only_while_it_surely_flies(phase, source):
    assert fly(motion(), phase, thrust=0.6).hover.source == source


def test_the_autopilots_thrust_tells_the_hover_thrust_until_the_own_inputs_fly():
    known = motion()
    for tick in range(12):
        found = known.update(state(0.1 * tick), [], hovers_at(0.6, tick), Phase.ENGAGE)
    assert found.hover.source == "autopilot"
    assert found.thrust_map.hover_thrust > 0.5
    own = motion()
    for tick in range(12):
        found = own.update(state(0.1 * tick), [], hovers_at(0.6, tick), Phase.FLY)
    assert found.hover.source == "configured"


class Measured:
    """The delay that `MotionEstimator` finds, as the made-up flights ask for it."""

    def __init__(self, known):
        self._known, self.sent = known, known.sent

    def measured(self, now, attitudes):
        found = self._known.update(state(now), attitudes, NOTHING, Phase.FLY)
        assert found.prediction.delay == found.delay.value
        return found.delay


def test_the_delay_is_measured_from_the_inputs_sent_and_the_rates_told():
    known = motion()
    flight = Flight(Measured(known), 3, 0.1, 0.02)
    before = flight.fly(5.0)
    assert before.value == pytest.approx(0.12, abs=0.01)
    known.clear()  # signals of before and after are not compared
    assert flight.fly(0.1) == before
    known.reset()
    assert known.update(None, [], NOTHING, Phase.WAIT).delay == before


@pytest.mark.parametrize("forget", [MotionEstimator.clear, MotionEstimator.reset])
def test_inputs_that_do_not_act_any_more_are_forgotten(forget):
    known = motion()
    known.sent(SentInput(0.0, np.array([5.0, 1.0, 0.0, 0.0]), 0.2))
    forget(known)
    assert known.update(state(), [], NOTHING, Phase.FLY).prediction.u_last == pytest.approx(HOVER)


def test_a_doubtful_delay_makes_a_changing_thrust_tell_less(monkeypatch):
    doubts = []
    for sigma in (0.0, 0.1):
        monkeypatch.setattr(DelayEstimator, "measured", lambda *_, s=sigma: Delay(0.06, s))
        known = motion()
        for tick in range(20):
            found = known.update(state(0.1 * tick), [], CARRIED, Phase.FLY)
            known.sent(SentInput(0.1 * tick, HOVER, 0.37 if tick % 2 else 0.43))
        doubts.append(found.hover.doubt)
    assert doubts[1] > 1.5 * doubts[0]


def test_a_reset_keeps_the_hover_thrust_and_forgets_the_wind():
    known = motion()
    fly(known, Phase.ENGAGE, q=ROLLED)
    before = fly(known, Phase.FLY, thrust=0.6)
    known.reset()
    assert not known.predictor.disturbance.any()
    after = known.update(None, [], NOTHING, Phase.WAIT)
    assert after.hover == before.hover


def test_motion_of_before_a_reset_is_not_compared_with_that_of_after_it():
    known = motion()
    for tick in range(5):
        before = known.update(state(0.1 * tick), [], hovers_at(0.4, tick), Phase.WAIT)
    known.reset()
    jumped = state(0.5, v=(0.0, 0.0, 1.0))
    assert known.update(jumped, [], hovers_at(0.4, 5), Phase.WAIT).hover == before.hover
