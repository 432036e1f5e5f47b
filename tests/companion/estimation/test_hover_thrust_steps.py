"""Hover thrust, observation by observation: what each tells, and what tells nothing."""

import numpy as np
import pytest

from companion.estimation.autopilot_thrust import AutopilotThrust
from companion.estimation.hover_thrust import HoverEstimate, HoverThrust
from companion.estimation.input_history import InputHistory, SentInput
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import (
    VehicleState,
)

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
TILTED = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])  # by 0.4 rad


def hover(configured=0.33, doubt=0.3, exponent=1.0, curve_known=True):
    """An estimate with its history of inputs, which act 0.06 s after they were sent."""
    history = InputHistory(0.06)
    return HoverThrust(ThrustMap(configured, exponent), doubt, history, curve_known), history


def state_at(time, climb=0.0, q=LEVEL):
    return VehicleState(time, np.zeros(3), np.array([0.0, 0.0, climb]), q, np.zeros(3))


def told_at(time, *thrusts, airborne=True):
    """The word of an autopilot whose thrusts all act within the 0.1 s before `time`."""
    return AutopilotThrust(tuple((time - 0.08, x) for x in thrusts), airborne=airborne)


def observe(seen, thrust=0.33, share=1.0, last=None, dt=0.1):
    """Return the estimate after one observation.

    share: acceleration over g in the second of two intervals. last: thrust in the first of them.
    """
    seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
    seen.update(state_at(1.1), told_at(1.1, last or thrust), False)
    climb = GRAVITY * (share - 1.0) * dt
    return seen.update(state_at(1.1 + dt, climb), told_at(1.1 + dt, thrust), False)


def posterior(doubt, noise, exponent=1.0):
    """Doubt after one observation whose logarithm has the 1 σ `noise`; it drifted for 0.2 s."""
    before = doubt**2 + 0.2 * 0.01**2
    return np.sqrt(before * noise**2 / (exponent**2 * before + noise**2))


def test_the_first_observation_is_taken_to_be_known_to_15_percent():
    assert observe(hover()[0]).doubt == pytest.approx(posterior(0.3, 0.15))
    square, _ = hover(exponent=2.0)
    assert observe(square).doubt == pytest.approx(posterior(0.3, 0.15, 2.0))


def test_an_acceleration_that_is_more_than_expected_means_a_lower_hover_thrust():
    before = 0.3**2 + 0.2 * 0.01**2
    share = before / (before + 0.15**2)
    found = observe(hover()[0], share=1.2)
    assert found.map.hover_thrust == pytest.approx(0.33 * 1.2**-share)
    assert found.map.exponent == 1.0


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_a_thrust_that_changes_tells_less_as_the_motors_lag(exponent):
    """Half of the change may not yet have been followed."""
    lag = 0.5 * exponent * np.log(0.33 / 0.22)
    found = observe(hover(exponent=exponent)[0], last=0.22)
    assert found.doubt == pytest.approx(posterior(0.3, np.hypot(0.15, lag), exponent))


@pytest.mark.parametrize(
    ("curve_known", "told", "doubt"), [(True, None, 0.1), (True, 1.0, 0.1), (False, None, 0.3)]
)
def test_how_well_the_exponent_is_known_depends_on_who_told_it(curve_known, told, doubt):
    """A thrust half as much again as hovering, that gives more than it should."""
    seen, _ = hover(curve_known=curve_known)
    seen.update(None, AutopilotThrust(curve=told), False)
    found = observe(seen, thrust=0.495, share=1.7)
    more = np.log(1.5)
    error = np.log(1.7) - more
    before, curve = 0.3**2 + 0.2 * 0.01**2, doubt**2 + 0.2 * 0.005**2
    total = before + more**2 * curve + 0.15**2
    assert found.map.exponent == pytest.approx(1.0 + curve * more * error / total)
    assert found.map.hover_thrust == pytest.approx(0.33 * np.exp(-before * error / total))


def test_the_curve_that_an_autopilot_tells_is_known_to_04():
    seen, _ = hover(curve_known=False)
    seen.update(None, AutopilotThrust(curve=1.0), False)
    found = observe(seen, thrust=0.495, share=1.7)
    more, before, curve = np.log(1.5), 0.3**2 + 0.2 * 0.01**2, 0.4**2 + 0.2 * 0.005**2
    error, total = np.log(1.7) - more, before + more**2 * curve + 0.15**2
    assert found.map.exponent == pytest.approx(1.0 + curve * more * error / total)


@pytest.mark.parametrize(
    ("curve", "exponent"), [(-0.01, 1.5), (0.0, 2.0), (1.0, 1.0), (1.01, 1.5), (None, 1.5)]
)
def test_a_thrust_curve_between_0_and_1_is_taken(curve, exponent):
    seen, _ = hover(exponent=1.5, curve_known=False)
    found = seen.update(None, AutopilotThrust(curve=curve), False)
    assert found.map.exponent == pytest.approx(exponent)


def test_a_thrust_curve_is_taken_once():
    seen, _ = hover(curve_known=False)
    seen.update(None, AutopilotThrust(curve=1.0), False)
    assert seen.update(None, AutopilotThrust(curve=0.0), False).map.exponent == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("told", "taken"), [(0.049, False), (0.05, True), (0.8, True), (0.81, False)]
)
def test_a_hover_thrust_that_a_drone_can_have_is_joined_with_the_configured_one(told, taken):
    """It is known to 0.2, and the configured one to 0.3: they weigh as 9 to 4."""
    seen, _ = hover(configured=0.3)
    found = seen.update(None, AutopilotThrust(hover=told), False)
    joined = np.exp((9.0 * np.log(told) + 4.0 * np.log(0.3)) / 13.0)
    assert found.map.hover_thrust == pytest.approx(joined if taken else 0.3)
    assert found.source == ("parameter" if taken else "configured")


def test_a_parameter_that_comes_after_a_flight_changes_nothing():
    seen, _ = hover()
    before = observe(seen)
    assert seen.update(None, AutopilotThrust(hover=0.6), False) == before


def test_a_parameter_that_changes_is_not_joined_again():
    seen, _ = hover()
    before = seen.update(None, AutopilotThrust(hover=0.5), False)
    assert seen.update(None, AutopilotThrust(hover=0.7), False) == before


def test_the_doubt_grows_by_1_percent_a_root_second():
    """The gaps are counted, not the ticks; nothing is told meanwhile."""
    seen, _ = hover(doubt=0.02)
    for k in range(41):
        found = seen.update(state_at(0.2 * k), AutopilotThrust(airborne=True), False)
    assert found.doubt == pytest.approx(np.sqrt(0.02**2 + 8.0 * 0.01**2))


def test_after_a_long_flight_the_doubt_is_that_of_the_drift_since_some_observations():
    """Of 5 % each, ten a second: where an observation takes away what the drift adds."""
    seen, _ = hover()
    for k in range(400):
        time = 1.0 + 0.1 * k
        found = seen.update(state_at(time), told_at(time, 0.33), False)
    added, noise = 0.1 * 0.01**2, 0.05**2
    settled = (np.sqrt(added**2 + 4.0 * added * noise) - added) / 2.0
    assert found.doubt == pytest.approx(np.sqrt(settled), rel=1e-3)


def test_a_single_knock_moves_the_estimate_no_farther_than_two_standard_deviations():
    before = 0.3**2 + 0.2 * 0.01**2
    total = before + 0.15**2
    found = observe(hover()[0], share=2.9)
    assert found.map.hover_thrust == pytest.approx(0.33 * np.exp(-2.0 * before / np.sqrt(total)))
    found = observe(hover(configured=0.45)[0], thrust=0.45, share=0.4)
    assert found.map.hover_thrust == pytest.approx(0.45 * np.exp(2.0 * before / np.sqrt(total)))


def sudden(seen, shares):
    """Fly for long with 0.33 that carries, then give other shares of g; return the hover thrusts.

    An exponent known to 0.1 changes nothing where thrust stays at what hovers.
    """
    found, climb, time = [], 0.0, 1.0
    for share in [1.0] * 60 + shares:
        time += 0.1
        climb += GRAVITY * (share - 1.0) * 0.1
        seen.update(state_at(time, climb), told_at(time, 0.33), False)
        found.append(seen.estimate.map.hover_thrust)
    return found[60:]


def test_four_surprises_on_end_mean_another_hover_thrust():
    found = sudden(hover()[0], [1.4] * 4)
    assert min(found[:3]) > 0.31
    assert found[3] < 0.27
    assert min(sudden(hover()[0], [1.4] * 3 + [1.0, 1.4])) > 0.30  # not on end


def test_surprises_one_way_and_the_other_are_knocks():
    assert min(sudden(hover()[0], [1.4, 1.4, 1.4, 0.6, 1.4, 1.4, 1.4])) > 0.29


def test_the_mismatch_is_the_mean_of_what_is_measured_over_what_is_expected():
    """A quarter of it is of the last 0.1 s, of 0.4 s."""
    assert observe(hover()[0], share=0.9).mismatch == pytest.approx(0.9**0.25 - 1.0)
    assert observe(hover()[0], share=1.2).mismatch == pytest.approx(1.2**0.25 - 1.0)
    assert hover()[0].estimate.mismatch == HoverEstimate(ThrustMap(), 0.3).mismatch == 0.0


@pytest.mark.parametrize(("share", "counts"), [(0.29, 0), (0.31, 1), (2.95, 1), (3.05, 0)])
def test_an_acceleration_that_no_thrust_can_mean_tells_nothing(share, counts):
    seen, _ = hover(configured=0.33)
    before = np.sqrt(0.3**2 + 0.2 * 0.01**2)
    found = observe(seen, share=share)
    assert found.doubt == pytest.approx(posterior(0.3, 0.15) if counts else before)


@pytest.mark.parametrize(
    ("thrust", "last", "counts"),
    [
        (0.89, 0.89, 1),
        (0.91, 0.91, 0),
        (0.5, 0.91, 0),
        (0.041, 0.041, 1),
        (0.039, 0.039, 0),
        (0.1, 0.039, 0),
    ],
)
def test_where_the_motors_saturate_nothing_is_learnt(thrust, last, counts):
    found = observe(hover()[0], thrust=thrust, last=last)
    assert found.source == ("autopilot" if counts else "configured")


@pytest.mark.parametrize(("dt", "counts"), [(0.24, True), (0.26, False), (-0.05, False)])
def test_two_states_far_apart_do_not_belong_together(dt, counts):
    assert (observe(hover()[0], dt=dt).source == "autopilot") == counts


@pytest.mark.parametrize("ours", [True, False])
def test_a_state_out_of_order_leaves_the_doubt_as_it_is(ours):
    seen, _ = hover()
    for time in (1.0, 0.95):
        found = seen.update(state_at(time), AutopilotThrust(airborne=True), ours)
    assert found.doubt == pytest.approx(0.3, rel=1e-9)


def test_after_a_gap_the_thrust_of_before_is_not_compared():
    seen, _ = hover()
    seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
    seen.update(state_at(1.1), told_at(1.1, 0.33), False)
    seen.update(None, AutopilotThrust(), False)
    for time, source in ((1.3, "configured"), (1.4, "configured"), (1.5, "autopilot")):
        found = seen.update(state_at(time), told_at(time, 0.33), False)
        assert found.source == source


def test_a_target_acts_003_s_later():
    for at, source in ((1.165, "autopilot"), (1.175, "configured"), (1.065, "configured")):
        seen, _ = hover()
        seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
        seen.update(state_at(1.1), told_at(1.1, 0.33), False)
        told = AutopilotThrust(((at, 0.33),), airborne=True)
        assert seen.update(state_at(1.2), told, False).source == source


def test_a_target_that_acts_later_is_kept_until_then():
    seen, _ = hover()
    seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
    early = AutopilotThrust(((1.05, 0.33), (1.15, 0.33)), airborne=True)
    seen.update(state_at(1.1), early, False)
    assert seen.update(state_at(1.2), AutopilotThrust(airborne=True), False).source == "autopilot"


def test_targets_of_before_a_reset_are_of_another_clock():
    seen, _ = hover()
    seen.update(state_at(1.0), AutopilotThrust(((1.15, 0.33),), airborne=True), False)
    seen.reset()
    seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
    seen.update(state_at(1.1), told_at(1.1, 0.33), False)
    assert seen.update(state_at(1.2), AutopilotThrust(airborne=True), False).source == "configured"


def test_several_targets_of_one_tick_are_averaged():
    """Each of them far off, their mean as expected."""
    seen, _ = hover()
    seen.update(state_at(1.0), AutopilotThrust(airborne=True), False)
    for time in (1.1, 1.2):
        found = seen.update(state_at(time), told_at(time, 0.23, 0.43), False)
    assert found.map.hover_thrust == pytest.approx(0.33)
    assert found.doubt == pytest.approx(posterior(0.3, 0.15))


def of_ours(inputs, sigma=0.0):
    """Return the estimate of a drone that hovers, by inputs sent: (time [s], thrust)."""
    seen, history = hover()
    history.delay_sigma = sigma
    for time, thrust in inputs:
        history.add(SentInput(time, np.zeros(4), thrust))
    for time in (1.0, 1.1, 1.2):
        found = seen.update(state_at(time), AutopilotThrust(airborne=True), True)
    return found


def test_the_own_thrust_is_the_mean_of_what_acted():
    """Of the last 0.1 s a quarter 0.23 and the rest 0.43, in the mean 0.38, as before."""
    found = of_ours([(0.9, 0.38), (1.04, 0.23), (1.065, 0.43)])
    same = of_ours([(0.9, 0.38)])
    assert same.source == found.source == "flight"
    assert found.map.hover_thrust == pytest.approx(same.map.hover_thrust)
    assert found.doubt == pytest.approx(same.doubt)


def test_a_thrust_that_was_not_all_of_ours_tells_nothing():
    """The interval before the last begins at 1.0 s."""
    assert of_ours([(0.93, 0.33)]).source == "flight"
    assert of_ours([(0.95, 0.33)]).source == "configured"


@pytest.mark.parametrize(("before", "after"), [(0.33, 0.36), (0.36, 0.33), (0.30, 0.36)])
def test_the_doubt_of_the_delay_is_doubt_of_the_thrust_that_acted(before, after):
    """By 0.1 s earlier or later, 0.33 was the thrust `before` or `after`: the farther one counts.

    The motors may not yet have followed half of the change to 0.33, either.
    """
    found = of_ours([(0.5, before), (1.04, 0.33), (1.14, after)], sigma=0.1)
    lag = 0.5 * np.log(0.33 / before)
    other = max(abs(np.log(before / 0.33)), abs(np.log(after / 0.33)))
    noise = np.sqrt(0.15**2 + lag**2 + other**2)
    assert found.doubt == pytest.approx(posterior(0.3, noise))


@pytest.mark.parametrize("exponent", [0.7, 2.5])
def test_an_exponent_that_is_configured_out_of_the_usual_is_kept(exponent):
    seen, _ = hover(exponent=exponent)
    assert observe(seen).map.exponent == pytest.approx(exponent)


def test_the_hover_thrust_stays_what_a_drone_can_have():
    seen, _ = hover(configured=0.78)
    assert observe(seen, thrust=0.85, share=0.5).map.hover_thrust == pytest.approx(0.8)
    seen, _ = hover(configured=0.06)
    assert observe(seen, thrust=0.05, share=2.0).map.hover_thrust == pytest.approx(0.05)


def test_the_reason_why_it_is_not_known_tells_how_far_it_is_and_what_to_do():
    estimate = hover()[0].estimate
    assert estimate.unknown_reason == (
        "hover thrust is known to ±30% only (0.33, configured), ±5% wanted: ATTITUDE_TARGET of a "
        "vehicle that hovers tells it, or set airframe.hover_thrust and hover_doubt"
    )
    assert not hover(doubt=0.051)[0].estimate.known
    assert hover(doubt=0.05)[0].estimate.unknown_reason == ""


def test_observations_that_differ_are_noisy():
    """The noise is half the square of what two differ by: with the first guess, a third of it."""
    seen, _ = hover()
    variance, noise = posterior(0.3, 0.15) ** 2, 0.15**2
    observe(seen)
    climb = GRAVITY * 0.3 * 0.1
    found = seen.update(state_at(1.3, climb), told_at(1.3, 0.33), False)
    variance += 0.1 * 0.01**2
    noise = (2.0 * noise + 0.5 * np.log(1.3) ** 2) / 3.0
    assert found.doubt == pytest.approx(np.sqrt(variance * noise / (variance + noise)))


def test_steady_observations_are_trusted_more_and_more():
    """Their noise is the mean of those so far, and later of 2 s; at first it is taken for 15 %."""
    seen, _ = hover()
    variance, noise = 0.3**2 + 0.2 * 0.01**2, 0.15**2
    for k in range(16):
        found = seen.update(state_at(1.0 + 0.2 * k), told_at(1.0 + 0.2 * k, 0.33), False)
    for n in range(1, 15):
        variance += 0.2 * 0.01**2
        if n > 1:
            noise *= 1.0 - max(0.2 / 2.0, 1.0 / (n + 1))
        weight = max(noise, 0.05**2)
        variance = variance * weight / (variance + weight)
    assert found.doubt == pytest.approx(np.sqrt(variance))
