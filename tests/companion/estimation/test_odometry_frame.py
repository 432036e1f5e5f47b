"""Odometry frame: steps of the position move the map, and never the drone."""

import numpy as np
import pytest

from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.velocity_by_sight import VelocityBySight
from mavlink_bridge.wire.messages import Attitude, LocalPosition, Odometry

V = np.array([1.5, 0.0, 0.0])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def fly(frame, step, seconds=4.0, resets=None, noise=(0.0, 0.0), sigma=0.05):
    """Fly straight on at 30 Hz; step(t): (3,) m that the position is off. Return the odometry."""
    rng, found = np.random.default_rng(5), []
    for k in range(round(seconds * 30)):
        t = k / 30
        p = V * t + step(t) + rng.normal(0.0, noise[0], 3)
        v = V + rng.normal(0.0, noise[1], 3)
        sent = [LocalPosition(t, p, v)]
        if resets is not None:
            sent.append(Odometry(t, p, v, LEVEL, np.zeros(3), resets=resets(t)))
        (local, *_) = frame.localised(sent, sigma)
        found.append((t, local.p))
    return found


def errors(found):
    return np.array([np.linalg.norm(p - V * t) for t, p in found])


def test_without_steps_the_position_is_the_reported_one():
    frame = OdometryFrame()
    found = fly(frame, lambda t: np.zeros(3), seconds=60.0, noise=(0.01, 0.03))
    assert frame.steps == 0
    assert not frame.offset.any()
    assert errors(found).max() < 0.06


def test_a_jump_of_vio_moves_the_map_and_not_the_drone():
    frame, jump = OdometryFrame(), np.array([0.15, -0.2, 0.05])
    found = fly(frame, lambda t: jump * (t >= 2.0))
    assert errors(found).max() < 1e-6
    assert frame.offset == pytest.approx(jump)


def test_a_step_that_slides_in_leaves_little_in_the_odometry():
    frame, step = OdometryFrame(), np.array([0.0, 1.2, 0.4])
    found = fly(frame, lambda t: step * (1.0 - np.exp(-max(t - 2.0, 0.0))), 8.0, sigma=0.15)
    assert errors(found).max() < 0.35
    assert frame.offset == pytest.approx(step, abs=0.3)


def test_a_large_jump_that_a_reset_announces_is_taken_out():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 2.0), resets=lambda t: 4 + (t >= 2.0))
    late = [e for (t, _), e in zip(found, errors(found), strict=True) if t > 2.1]
    assert max(late) < 1e-6  # one sample comes before the reset is known: it is refused later
    assert frame.offset == pytest.approx(jump)


def test_a_large_jump_that_nothing_announces_stays_a_fault():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 2.0))
    assert errors(found)[-1] == pytest.approx(3.0)
    assert not frame.offset.any()


def test_the_first_count_of_resets_announces_none():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 0.2), seconds=1.0, resets=lambda t: 4)
    assert errors(found)[-1] == pytest.approx(3.0)
    assert not frame.offset.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_velocity_that_is_no_number_spoils_nothing_after_it(bad, axis):
    frame = OdometryFrame()
    frame.by_sight = VelocityBySight(turn=0.1, error=np.array([0.2, 0.0, 0.0]))
    v = np.array([1.0, 0.0, 0.0])
    for k in range(10):
        told = v.copy()
        told[axis] = bad if k == 5 else v[axis]
        ((local,), (odometry,)) = (
            list(frame.localised([m], 0.05))
            for m in (
                LocalPosition(0.02 * k, 0.02 * k * v, told),
                Odometry(0.02 * k, 0.02 * k * v, told, np.array([1.0, 0, 0, 0]), np.zeros(3)),
            )
        )
        assert np.isfinite(frame.offset).all()
        assert np.isfinite([*local.v, *odometry.v]).all() == (k != 5)
    assert frame.offset[0] == pytest.approx(-0.2 * 0.18, abs=0.01)


HOVER = np.zeros(3)


def hear(frame, *places, sigma=0.05, dt=0.1, start=0.0, v=HOVER):
    """Tell of places east [m], one each `dt` [s]; return those in odometry, (n,3) m."""
    sent = [
        LocalPosition(start + k * dt, np.array([x, 0.0, 0.0]), np.array(v))
        for k, x in enumerate(places)
    ]
    return np.array([m.p for m in frame.localised(sent, sigma)])


@pytest.mark.parametrize(
    ("step", "sigma", "taken"),
    [(0.12, 0.05, False), (0.14, 0.05, True), (0.22, 0.15, False), (0.24, 0.15, True)],
)
def test_a_step_is_taken_out_from_8_cm_and_a_second_of_the_velocitys_doubt_on(step, sigma, taken):
    frame = OdometryFrame()
    found = hear(frame, 0.0, 0.0, -step, sigma=sigma)
    assert found[-1] == pytest.approx([0.0 if taken else -step, 0.0, 0.0])
    assert frame.offset == pytest.approx([-step if taken else 0.0, 0.0, 0.0])
    assert frame.steps == taken


@pytest.mark.parametrize(("dt", "taken"), [(0.1, True), (0.2, False)])
def test_small_steps_add_up_within_half_a_second(dt, taken):
    """Two of 7.5 cm: what is left of the first one and the second are 13.6 cm, or 12.5 cm."""
    frame = OdometryFrame()
    hear(frame, 0.0, 0.075, 0.15, dt=dt)
    assert frame.steps == taken
    left = 0.075 * np.exp(-0.1 / 0.5) + 0.075 if taken else 0.0
    assert frame.slid == pytest.approx([left, 0.0, 0.0])


@pytest.mark.parametrize(("after", "slid"), [(1.4, 0.55), (1.6, 0.5)])
def test_for_one_and_a_half_seconds_after_a_step_the_velocity_alone_counts(after, slid):
    frame = OdometryFrame()
    ticks = round(after / 0.1)
    hear(frame, 0.0, *ticks * [0.5], 0.55)
    assert frame.slid == pytest.approx([slid, 0.0, 0.0], abs=1e-9)
    assert frame.steps == 1


@pytest.mark.parametrize(("step", "taken"), [(0.99, True), (1.01, False), (-1.01, False)])
def test_a_step_of_more_than_a_metre_is_a_fault(step, taken):
    frame = OdometryFrame()
    found = hear(frame, 0.0, step)
    assert found[-1, 0] == pytest.approx(0.0 if taken else step)
    assert frame.steps == taken


@pytest.mark.parametrize(("after", "taken"), [(0.1, 1), (0.2, 1), (0.4, 0)])
def test_a_reset_explains_steps_for_three_tenths_of_a_second(after, taken):
    frame = OdometryFrame()
    hear(frame, 0.0, 0.0, 0.0)
    for resets in (3, 4):
        list(frame.localised([Odometry(0.2, HOVER, HOVER, LEVEL, HOVER, resets=resets)], 0.05))
    hear(frame, *(round(after / 0.1) - 1) * [0.0], 3.0, start=0.3)
    assert frame.steps == taken


@pytest.mark.parametrize(("gap", "taken"), [(0.24, 1), (0.26, 0)])
def test_over_more_than_a_quarter_of_a_second_the_velocity_says_too_little(gap, taken):
    frame = OdometryFrame()
    found = hear(frame, 0.0, 0.5, dt=gap)
    assert frame.steps == taken
    assert found[-1, 0] == pytest.approx(0.0 if taken else 0.5)


@pytest.mark.parametrize(("gap", "known"), [(0.24, True), (0.26, False)])
def test_the_way_by_sight_goes_on_over_gaps_of_a_quarter_of_a_second(gap, known):
    frame = OdometryFrame()
    frame.by_sight = VelocityBySight(error=np.array([0.2, -0.1, 0.0]))
    found = hear(frame, 0.0, gap, dt=gap, v=(1.0, 0.0, 0.0))
    way = gap * np.array([0.2, -0.1, 0.0]) * known
    assert found[-1] - [gap, 0.0, 0.0] == pytest.approx(way)
    assert frame.offset == pytest.approx(-way)
    assert not frame.slid.any()


def test_a_sample_that_comes_again_moves_nothing():
    frame = OdometryFrame()
    frame.by_sight = VelocityBySight(error=np.array([0.2, 0.0, 0.0]))
    hear(frame, 0.0, 0.0)
    offset = frame.offset
    assert offset == pytest.approx([-0.02, 0.0, 0.0])
    hear(frame, 0.7, start=0.1)
    assert frame.offset == pytest.approx(offset)


def test_other_messages_pass_as_they_are():
    attitude = Attitude(0.0, LEVEL, HOVER)
    (out,) = OdometryFrame().localised([attitude], 0.05)
    assert out is attitude


def test_an_odometry_tells_the_place_and_velocity_in_odometry_and_all_else_as_it_came():
    frame = OdometryFrame()
    hear(frame, 0.0, 0.5)
    frame.by_sight = VelocityBySight(turn=np.pi / 2, error=np.array([0.0, 0.0, 0.1]))
    told = Odometry(0.15, np.array([0.6, 0.0, 2.0]), V, LEVEL, np.ones(3), resets=7)
    (out,) = frame.localised([told], 0.05)
    assert out.p == pytest.approx([0.1, 0.0, 2.0])
    assert out.v == pytest.approx([0.0, 1.5, 0.1])
    assert (out.time, out.resets) == (0.15, 7)
    assert out.omega.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(("since", "steps"), [(0.45, 0), (0.55, 1)])
def test_odometry_gives_the_place_after_half_a_second_without_local_positions(since, steps):
    frame = OdometryFrame()
    hear(frame, 0.0)
    times = [since, since + 0.04] if steps else [since - 0.04, since]
    for time, x in zip(times, (0.0, 0.5), strict=True):
        told = Odometry(time, np.array([x, 0.0, 0.0]), HOVER, LEVEL, HOVER)
        list(frame.localised([told], 0.05))
    assert frame.steps == steps
    assert frame.offset[0] == pytest.approx(0.5 * steps)


@pytest.mark.parametrize("v", [1.0, -0.5])
def test_a_velocity_that_leaves_the_positions_behind_for_long_is_corrected(v):
    """By 0.3 m/s, for a minute; a tenth of it may be the positions' own, which slide by 0.1 m/s."""
    frame = OdometryFrame()
    for k in range(600):
        told = LocalPosition(
            0.1 * k, np.array([0.1 * k * (v + 0.3), 0.0, 0.0]), np.array([v, 0, 0])
        )
        (local,) = frame.localised([told], 0.05)
    assert local.v == pytest.approx([v + 0.27, 0.0, 0.0], abs=0.002)
    (out,) = frame.localised([Odometry(60.0, local.p, np.array([v, 0, 0]), LEVEL, HOVER)], 0.05)
    assert out.v == pytest.approx([v + 0.27, 0.0, 0.0], abs=0.002)
