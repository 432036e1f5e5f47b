"""The whole estimate of a vehicle: what its parts find reaches the state."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import StatePredictor
from companion.estimation.turns import Turn
from companion.estimation.vehicle import VehicleEstimate, VehicleEstimator
from companion.perception.camera_health import CameraFault
from companion.perception.ground_flow import GroundFlow
from companion.perception.parallax import FixedPoints
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    CommandAck,
    DistanceSensor,
    EstimatorStatus,
    Heartbeat,
    HomePosition,
    LocalPosition,
    Received,
    Source,
)

LEVEL, V, DOWN = np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 25


@pytest.mark.parametrize("sees_ground", [True, False])
def test_a_step_of_the_told_velocity_does_not_reach_the_state_where_ground_was_seen(sees_ground):
    """It flies on at 1 m/s; from 8 s on 0.4 m/s more are told."""
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    predictor, errors, at = StatePredictor(InputHistory(0.06)), {}, Source(1, 1)
    for k in range(1, 101):
        heard = []
        for t in (0.1 * k - 0.02 * j for j in range(4, -1, -1)):
            p = V * t + [0.0, 0.0, 2.0]
            told = np.array([1.0, 0.4 * (t > 7.99), 0.0])
            heard += [Attitude(t, LEVEL, np.zeros(3)), LocalPosition(t, p, told)]
        heard.append(DistanceSensor(0.1 * k, 2.0, 0.1, 12.0, DOWN))
        received = [Received(at, m) for m in heard]
        found = vehicle.update(0.1 * k, received, predictor, Phase.FLY)
        errors[k] = found.state.v - V
        if sees_ground and k > 1:
            flow = GroundFlow(0.1 * (k - 1), 0.1 * k, 0.1 * V[:2], 2.0)
            vehicle.see_flow(flow, CameraFault.NONE)
    assert np.linalg.norm(errors[79]) < 0.05
    assert not sees_ground or np.linalg.norm(errors[80]) < 0.01  # at once
    # The flow over the step itself shows half of it; then the ground settles what is left.
    worst = max(np.linalg.norm(errors[k]) for k in range(80, 101))
    assert worst < 0.2 if sees_ground else worst > 0.35


def test_before_a_state_is_told_there_is_none():
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    found = vehicle.update(0.1, [], StatePredictor(InputHistory(0.06)), Phase.PASSIVE)
    assert found.state is None
    assert found.height is None


@pytest.mark.parametrize("phase", [Phase.FLY, Phase.PASSIVE])
def test_a_late_state_is_carried_on_by_the_model_in_flight_alone(phase):
    """At 0.5 s nothing was heard for 0.3 s; the last input pitched the drone down."""
    history = InputHistory(0.06)
    predictor, at = StatePredictor(history), Source(1, 1)
    vehicle = VehicleEstimator(Identity("px4", 1), 1, silence=1.0, predict_after=0.2)
    for k in range(1, 6):
        t, p = 0.1 * k, V * 0.1 * k + [0.0, 0.0, 2.0]
        heard = [Attitude(t, LEVEL, np.zeros(3)), LocalPosition(t, p, V)] if k < 3 else []
        found = vehicle.update(t, [Received(at, m) for m in heard], predictor, phase)
        history.add(SentInput(t, np.array([GRAVITY, 0.0, 2.0, 0.0]), 0.3))
    carried = abs(found.state.q_wb[2]) > 0.05
    assert carried == (phase is Phase.FLY)


def test_without_news_an_estimate_grows_old_and_tells_nothing_new():
    attitude = Attitude(0.0, LEVEL, np.zeros(3))
    turn = Turn(0.0, 0.02, True, (0.0, 0.0, 0.1), 0.0, 0.1)
    news = {"refusals": ("arm: denied",), "attitudes": (attitude,), "turns": (turn,)}
    told = VehicleEstimate(age=0.1, rebooted=True, mode_known=True, turned=0.1, **news)
    later = told.without_news(0.2)
    assert later.age == pytest.approx(0.3)
    assert later.tick_gap == 0.2
    assert later.rebooted is False
    assert later.turned == 0.0
    assert (later.refusals, later.attitudes, later.turns) == ((), (), ())


HERE = Source(1, 1)
STANDS, FLIES = Heartbeat(12, 2, False, 0, 3), Heartbeat(12, 2, True, 0, 4)
HOME = HomePosition(47.0, 8.0, 500.0)


class Vehicle:
    """An estimator that is told of a drone 2 m up, which flies on at `v` (3,) m/s."""

    def __init__(self, v=V, predict_after=0.2):
        self.v = v
        self.estimator = VehicleEstimator(
            Identity("px4", 1), 1, silence=1.0, predict_after=predict_after
        )
        self.inputs = InputHistory(0.06)
        self._predictor = StatePredictor(self.inputs)

    def tick(self, time, *more, phase=Phase.PASSIVE, silent=False, source=HERE, horizon=np.inf):
        """Return the estimate at `time` [s], with telemetry of now unless it is silent."""
        here = self.v * time + [0.0, 0.0, 2.0]
        told = [Attitude(time, LEVEL, np.zeros(3)), LocalPosition(time, here, self.v)]
        received = [Received(source, m) for m in (*([] if silent else told), *more)]
        return self.estimator.update(time, received, self._predictor, phase, horizon)


@pytest.mark.parametrize("source", [Source(2, 1), Source(1, 2)])
def test_what_others_send_is_not_of_this_vehicle(source):
    found = Vehicle().tick(0.1, HOME, FLIES, source=source)
    assert (found.state, found.home, found.heartbeat) == (None, None, None)
    assert found.age == np.inf
    assert found.attitudes == ()
    assert not found.mode_known


def test_an_estimate_tells_what_came_with_the_tick():
    vehicle = Vehicle()
    first = vehicle.tick(0.125, FLIES, HOME)
    assert first.state.p == pytest.approx([0.125, 0.0, 2.0])
    assert first.state.v == pytest.approx(V)
    assert (first.tick_gap, first.age) == (0.0, 0.0)
    assert (first.heartbeat, first.home) == (FLIES, HOME)
    assert first.mode_known
    assert first.plausible
    assert not first.rebooted
    assert [a.time for a in first.attitudes] == [0.125]
    assert first.refusals == ()
    later = vehicle.tick(0.5, silent=True)
    assert (later.tick_gap, later.age) == (0.375, 0.375)
    assert later.attitudes == ()
    assert (later.heartbeat, later.home) == (FLIES, HOME)


@pytest.mark.parametrize(("gap", "known"), [(0.5, True), (0.51, False)])
def test_without_news_the_mode_is_known_to_the_age_of_a_second(gap, known):
    told = VehicleEstimate(age=0.5, mode_known=True)
    assert told.without_news(gap).mode_known is known
    assert not replace(told, mode_known=False).without_news(gap).mode_known


def test_without_news_the_rest_of_an_estimate_stays():
    told = VehicleEstimate(age=0.5, ahead=3, packet_loss=0.1, heartbeat=FLIES, home=HOME)
    later = told.without_news(0.1)
    assert (later.ahead, later.packet_loss) == (3, 0.1)
    assert (later.heartbeat, later.home) == (FLIES, HOME)


def test_before_anything_is_known_an_estimate_is_infinitely_old_and_plausible():
    nothing = VehicleEstimate()
    assert nothing.age == np.inf
    assert nothing.plausible
    assert (nothing.ahead, nothing.packet_loss, nothing.tick_gap, nothing.turned) == (0, 0, 0, 0)
    assert (nothing.mode_known, nothing.rebooted, nothing.inhibit_reason) == (False, False, "")
    assert nothing.map_offset.tolist() == nothing.slid.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    "other",
    [
        replace(HOME, latitude_deg=47.1),
        replace(HOME, longitude_deg=8.1),
        replace(HOME, altitude=501.0),
        replace(HOME, p=np.array([0.0, 0.0, 0.1])),
    ],
)
def test_a_home_that_comes_again_is_no_new_one_and_another_one_is(other):
    vehicle = Vehicle()
    assert vehicle.tick(0.1, HOME).home is HOME
    assert vehicle.tick(0.2, replace(HOME, p=np.zeros(3))).home is HOME
    assert vehicle.tick(0.3, other).home is other


@pytest.mark.parametrize(("back", "rebooted"), [(0.9, False), (1.1, True)])
def test_a_time_that_goes_back_by_more_than_a_second_is_a_reboot(back, rebooted):
    """The estimator forgets what hangs on clock and frame: home, and the level of the ground."""
    vehicle = Vehicle()
    vehicle.tick(49.9, HOME, FLIES, *(5 * [DistanceSensor(49.9, 1.0, 0.1, 12.0, DOWN)]))
    assert vehicle.tick(50.0).height.value == pytest.approx(1.0, abs=0.01)
    found = vehicle.tick(50.0 - back, silent=True)
    assert found.rebooted is rebooted
    assert found.home is (None if rebooted else HOME)
    assert found.mode_known is not rebooted
    assert found.tick_gap == pytest.approx(0.0 if rebooted else -back)
    assert found.height.value == pytest.approx(2.0 if rebooted else 1.0, abs=0.01)
    assert not vehicle.tick(50.1 - back, silent=True).rebooted


def test_telemetry_whose_clock_goes_back_is_a_reboot_once():
    vehicle = Vehicle()
    vehicle.tick(50.0, HOME)
    back = [LocalPosition(3.0 + 0.02 * k, np.zeros(3), V) for k in range(3)]
    found = vehicle.tick(50.1, *back, silent=True)
    assert found.rebooted
    assert (found.home, found.tick_gap) == (None, 0.0)
    assert found.state is None
    again = vehicle.tick(50.2, silent=True)
    assert not again.rebooted
    assert again.tick_gap == pytest.approx(0.1)


@pytest.mark.parametrize(("heartbeat", "height"), [(STANDS, 0.0), (FLIES, 2.0), (None, 2.0)])
def test_a_disarmed_vehicle_stands_on_the_ground(heartbeat, height):
    found = Vehicle().tick(0.1, *([heartbeat] if heartbeat else []))
    assert found.height.value == pytest.approx(height)


def test_the_mode_is_not_known_after_a_second_of_silence():
    vehicle = Vehicle()
    vehicle.tick(0.0, FLIES)
    assert vehicle.tick(0.9, silent=True).mode_known
    assert not vehicle.tick(1.1).mode_known


def test_lost_frames_of_the_last_second_are_told():
    vehicle = Vehicle()
    vehicle.tick(0.0, *30 * [FLIES])
    lost = [Received(HERE, FLIES, missing=8)]
    found = vehicle.estimator.update(0.1, lost, StatePredictor(vehicle.inputs), Phase.PASSIVE)
    assert found.packet_loss == pytest.approx(8 / 41)


def test_samples_of_the_future_are_counted_and_change_nothing():
    vehicle = Vehicle()
    vehicle.tick(0.1)
    ahead = LocalPosition(0.4, np.array([0.4, 0.0, 2.0]), 2.0 * V)
    found = vehicle.tick(0.2, ahead, horizon=0.2)
    assert found.ahead == 1
    assert found.state.v == pytest.approx(V)


def test_a_refusal_is_told_in_words_at_the_tick_at_which_it_came():
    vehicle = Vehicle()
    vehicle.estimator.ask([Command(400, (1.0, *6 * [0.0]))])
    (words,) = vehicle.tick(0.1, CommandAck(400, 2)).refusals
    assert words == "arm: denied"
    assert vehicle.tick(0.2).refusals == ()


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (EstimatorStatus(0.1, 0, 0.5, 0.5), "no attitude"),
        (Heartbeat(3, 2, True, 0, 4), "vehicle 1 is ardupilot"),
    ],
)
def test_a_vehicle_that_is_not_to_be_flown_says_why(message, reason):
    assert Vehicle().tick(0.0).inhibit_reason == ""
    assert reason in Vehicle().tick(0.1, message).inhibit_reason.lower()


def test_the_doubt_of_the_velocity_is_that_by_sight():
    vehicle = Vehicle()
    vehicle.tick(0.1)
    found = vehicle.tick(0.2)
    assert found.doubt.velocity == found.by_sight.sigma
    assert found.by_sight.sigma == pytest.approx(np.hypot(0.05, 0.006))  # at 1 m/s
    assert found.doubt.position == 0.05


@pytest.mark.parametrize(("silent", "carried"), [(2, False), (3, True)])
def test_the_model_predicts_from_an_age_above_the_one_that_is_set(silent, carried):
    """Two ticks without news are 0.25 s; the input pitched the drone down."""
    vehicle = Vehicle(predict_after=0.25)
    for k in range(1, 5):
        found = vehicle.tick(0.125 * k, phase=Phase.FLY)
        vehicle.inputs.add(SentInput(0.125 * k, np.array([GRAVITY, 0.0, 2.0, 0.0]), 0.3))
    for k in range(5, 5 + silent):
        found = vehicle.tick(0.125 * k, phase=Phase.FLY, silent=True)
    assert (abs(found.state.q_wb[2]) > 0.05) == carried


def test_a_picture_of_a_time_that_telemetry_has_not_told_is_seen_from_where_the_model_puts_it():
    vehicle = Vehicle()
    for k in range(1, 5):
        vehicle.tick(0.125 * k, phase=Phase.FLY)
        vehicle.inputs.add(SentInput(0.125 * k, np.array([GRAVITY, 0.0, 2.0, 0.0]), 0.3))
    assert abs(vehicle.estimator.at(0.75).q_wb[2]) > 0.05
    assert vehicle.estimator.at(0.25).p == pytest.approx([0.25, 0.0, 2.0])
    assert vehicle.estimator.at(0.25).q_wb == pytest.approx(LEVEL)
    assert Vehicle().estimator.at(0.25) is None


def seen(vehicle, off, begin=1, ticks=10):
    """Let a vehicle see ground that passes `off` (2,) m/s faster than told, at each tick."""
    for k in range(begin, begin + ticks):
        found = vehicle.tick(0.1 * k)
        way = 0.1 * (vehicle.v[:2] + off)
        flow = GroundFlow(0.1 * (k - 1), 0.1 * k, way, 2.0)
        vehicle.estimator.see_flow(flow if k > 1 else None, CameraFault.NONE)
    return found


@pytest.mark.parametrize("fault", [CameraFault.NONE, CameraFault.MISALIGNED])
def test_what_a_misaligned_camera_has_shown_is_forgotten(fault):
    vehicle = Vehicle()
    assert seen(vehicle, np.array([0.0, 0.1])).by_sight.error[1] > 0.005
    vehicle.estimator.see_flow(None, fault)
    found = vehicle.tick(1.1)
    assert (found.by_sight.error[1] > 0.005) == (fault is CameraFault.NONE)
    assert np.isfinite(found.by_sight.shown) == (fault is CameraFault.NONE)


def test_a_velocity_by_sight_reaches_the_state_and_moves_the_map():
    """Metre by metre the position in odometry goes aside, and the map the other way."""
    vehicle = Vehicle()
    seen(vehicle, np.array([0.0, 0.1]), ticks=20)
    found = vehicle.tick(2.1)
    assert found.state.v == pytest.approx(found.by_sight.corrected(V))
    assert found.map_offset[1] < -0.005
    assert found.state.p + found.map_offset == pytest.approx([2.1, 0.0, 2.0])
    assert not found.slid.any()


def test_a_flow_before_telemetry_says_nothing():
    vehicle = Vehicle()
    vehicle.estimator.see_flow(GroundFlow(0.0, 0.1, np.ones(2), 2.0), CameraFault.NONE)
    assert not vehicle.tick(0.2).by_sight.error.any()


@pytest.mark.parametrize(("trunks", "corrected"), [([], True), ([[0.0, 0.0, 9.0]], False)])
def test_points_of_a_picture_correct_the_height_unless_they_may_be_of_a_known_trunk(
    trunks, corrected
):
    vehicle = Vehicle()
    own = vehicle.tick(0.0).state
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    rows = np.zeros((8, 7))
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = np.cos(angles), np.sin(angles), 0.1, 0.05
    points = FixedPoints.from_rows(rows)
    vehicle.estimator.see_ground(None, points, np.zeros((0, 3)))
    assert vehicle.tick(0.0, silent=True).height.value == 2.0
    vehicle.estimator.see_ground(own, points, np.reshape(trunks, (-1, 3)))
    assert (vehicle.tick(0.0, silent=True).height.value < 1.999) is corrected


@pytest.mark.parametrize("up", [0.1, -0.2])
def test_a_heading_that_turns_and_the_gyro_does_not_is_told_as_a_turn(up):
    vehicle = Vehicle()
    vehicle.tick(0.0)
    q = np.array([np.cos(0.5 * up), 0.0, 0.0, np.sin(0.5 * up)])
    found = vehicle.tick(0.02, Attitude(0.02, q, np.zeros(3)), silent=True)
    assert found.turned == pytest.approx(up, rel=0.01)
    assert [t.up for t in found.turns] == pytest.approx([up], rel=0.01)
