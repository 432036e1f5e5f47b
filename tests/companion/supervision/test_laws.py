"""Brake, level and the ways to stop, against the same laws written down a second time."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.supervision.braking import brake, brake_late, level
from companion.supervision.evasion import STRAIGHT, Law, Ways, aside, simulate
from companion.supervision.guard_config import GuardConfig
from mavlink_bridge.wire.messages import VehicleState

G, DT = 9.80665, 0.1
CONFIG = GuardConfig()


def own(rng, tilt=0.5, speed=1.5):
    turn = Rotation.from_rotvec(rng.normal(size=3) * [tilt, tilt, 2.0])
    q = np.roll(turn.as_quat(), 1)
    return VehicleState(0.0, rng.normal(size=3), speed * rng.normal(size=3), q, rng.normal(size=3))


def towards(force, q, gain, config):
    """The command that turns the thrust towards a force [m/s²]."""
    turn = Rotation.from_quat(np.roll(q, -1))
    want = turn.inv().apply(force / np.linalg.norm(force))
    x, y = -want[1], want[0]
    if want[2] < 0.0:
        x, y = np.array([x, y]) / np.hypot(x, y)
    rate = config.omega_max
    omega = [min(max(gain * a, -rate), rate) for a in (x, y)] + [0.0]
    along = float(force @ turn.apply([0, 0, 1]))
    return np.array([min(max(along, config.c_min), config.c_max), *omega])


def against(v, horizontal, vertical, config):
    sideways = -horizontal * v[:2]
    sideways *= min(1.0, config.brake_max / max(np.hypot(*sideways), 1e-12))
    return np.array([*sideways, G + min(max(-vertical * v[2], -3.0), 3.0)])


def as_array(command):
    return np.array([command.c, *command.omega])


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("tilt", [0.3, 1.6])
@pytest.mark.parametrize("gusts", [0.0, 1.0])
def test_the_brake_tilts_against_what_the_velocity_will_be_and_against_the_wind(seed, tilt, gusts):
    rng = np.random.default_rng(seed)
    s, wind = own(rng, tilt), gusts * rng.normal(size=3)
    axis = Rotation.from_quat(np.roll(s.q_wb, -1)).apply([0, 0, 1])
    then = s.v + 0.1 * (G * axis + wind) * [1.0, 1.0, 0.0]
    force = against(then, CONFIG.brake_gain, CONFIG.brake_gain, CONFIG) - wind
    wanted = towards(force, s.q_wb, CONFIG.attitude_gain, CONFIG)
    assert as_array(brake(s, CONFIG, wind)) == pytest.approx(wanted, abs=1e-9)
    if not gusts:
        assert as_array(brake(s, CONFIG)) == pytest.approx(wanted, abs=1e-9)


def test_a_drone_that_leans_into_the_wind_stands_still():
    wind = np.array([0.9, -0.4, 0.3])
    force = np.array([0.0, 0.0, G]) - wind
    turn, _ = Rotation.align_vectors([force], [[0.0, 0.0, 1.0]])
    s = replace(own(np.random.default_rng(1)), v=np.zeros(3), q_wb=np.roll(turn.as_quat(), 1))
    # Its thrust is a little more than the weight, so that it leans a little too much.
    command = brake(s, CONFIG, wind)
    assert command.omega == pytest.approx(np.zeros(3), abs=0.03)
    assert command.c == pytest.approx(np.linalg.norm(force), abs=0.01)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("held", [0.05, 0.12, 0.3, 0.5, 2.0])
def test_a_late_brake_has_a_gain_by_how_long_it_is_held(seed, held):
    s = own(np.random.default_rng(seed), 0.2, 0.6)
    gain = min(0.7 / held, CONFIG.attitude_gain)
    turned = Rotation.from_quat(np.roll(s.q_wb, -1)) * Rotation.from_rotvec(
        0.75 * min(held, 0.5) * s.omega
    )
    force = against(s.v, min(0.25 * gain, CONFIG.brake_gain), gain, CONFIG)
    wanted = towards(force, np.roll(turned.as_quat(), 1), gain, CONFIG)
    assert as_array(brake_late(s, CONFIG, held)) == pytest.approx(wanted, abs=2e-3)


@pytest.mark.parametrize("seed", range(20))
def test_levelling_looks_at_the_attitude_alone(seed):
    s = own(np.random.default_rng(seed), 1.0)
    wanted = towards(np.array([0.0, 0.0, G]), s.q_wb, CONFIG.attitude_gain, CONFIG)
    assert as_array(level(s, CONFIG)) == pytest.approx(wanted, abs=1e-9)
    blind = replace(s, p=np.full(3, np.nan), v=np.full(3, np.nan), omega=np.full(3, np.nan))
    assert as_array(level(blind, CONFIG)) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("size", [1e200, np.inf, np.nan])
@pytest.mark.parametrize("law", [brake, lambda s, c: brake_late(s, c, 0.1)])
def test_numbers_too_large_to_reckon_with_give_a_hover(size, law):
    s = own(np.random.default_rng(1))
    with np.errstate(all="ignore"):
        command = law(replace(s, v=np.array([size, 0.0, 0.0])), CONFIG)
        spoilt = law(replace(s, q_wb=np.full(4, size)), CONFIG)
    assert np.isfinite(command.omega).all()
    assert CONFIG.c_min <= command.c <= CONFIG.c_max
    assert not np.isfinite(size) or np.isfinite(as_array(spoilt)).all()
    assert np.isfinite(size) or as_array(spoilt).tolist() == [G, 0.0, 0.0, 0.0]


def test_upside_down_it_turns_at_full_rate():
    s = own(np.random.default_rng(1))
    over = replace(s, q_wb=np.array([0.1, 1.0, 0.0, 0.0]) / np.sqrt(1.01))
    omega = level(over, replace_gain(CONFIG, 1.0)).omega
    assert np.linalg.norm(omega) == pytest.approx(1.0)
    exactly = replace(s, q_wb=np.array([0.0, 1.0, 0.0, 0.0]))
    assert np.isfinite(level(exactly, CONFIG).omega).all()


def replace_gain(config, gain):
    return config.model_copy(update={"attitude_gain": gain})


LAW = Law(4.5, 6.0, 6.0, 3.0, 2.0, 20.0)
SLOW = Law(2.0, 3.0, 15.0, 1.0, 5.0, 12.0, 0.7)


def flown(x0, velocity, hold, wind, law, first):
    """One way by vectors and rotations: first command, places and velocities."""
    r = Rotation.from_quat(np.roll(x0[6:10], -1))
    p, v, a = x0[:3].copy(), x0[3:6].copy(), r.apply([0, 0, 1])
    weight = np.array([0.0, 0.0, G]) - wind
    places, speeds, u = [p], [v], None
    for k in range(16):
        if k == 0 and first is not None:
            u = first
            c = first[0]
            b = a + DT * np.cross(r.apply([first[1], first[2], 0.0]), a)
            b = b / np.linalg.norm(b)
        else:
            missing = (velocity if hold > DT * k else np.zeros(3)) - v
            push = law.brake_gain * missing
            push[:2] *= min(1.0, law.brake_max / max(np.hypot(*push[:2]), 1e-12))
            push[2] = min(max(push[2], -3.0), 3.0)
            force = push + weight
            size = np.linalg.norm(force)
            cosine = a @ force / size
            turn = np.cross(a, force / size)
            angle = min(min(law.attitude_gain * DT, 1.0) * np.arctan2(np.linalg.norm(turn), cosine),
                        law.omega_max * DT)  # fmt: skip
            turn = angle * turn / max(np.linalg.norm(turn), 1e-12)
            b = Rotation.from_rotvec(turn).apply(a)
            c = min(max(size * cosine, law.c_min), law.c_max)
            if k == 0:
                rates = r.inv().apply(turn) / DT + [0.0, 0.0, law.yaw_rate]
                u = np.array([c, *np.clip(rates, -law.omega_max, law.omega_max)])
        before, after = c * a - weight, c * b - weight
        p = p + DT * v + DT**2 / 6.0 * (2.0 * before + after)
        v = v + 0.5 * DT * (before + after)
        a = b
        places.append(p)
        speeds.append(v)
        if k > 0 and hold <= DT * k and np.abs(v).max() < 0.05:
            break
    left = 17 - len(places)
    return u, np.array(places + [p] * left), np.array(speeds + [np.zeros(3)] * left)


@pytest.mark.parametrize("law", [LAW, SLOW])
@pytest.mark.parametrize("commanded", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_ways_to_stop_are_flown_by_the_law(law, commanded, seed):
    rng = np.random.default_rng(seed)
    s = own(rng, 0.3, (0.3, 1.2)[seed % 2])
    x0 = np.array([*s.p, *s.v, *s.q_wb])
    first = np.array([8.0 + 4.0 * rng.random(), *rng.normal(size=3)]) if commanded else None
    wind = 0.5 * rng.normal(size=3)
    sides = aside(s.v, 1.2, 0.5)
    ways = Ways(
        np.concatenate([STRAIGHT.velocity, sides.velocity, 3.0 * rng.normal(size=(2, 3))]),
        np.array([0.0, *sides.hold, 0.25, 1.7]),
    )
    found = simulate(x0, ways, wind, law, first)
    assert found.p.shape == found.v.shape == (13, 17, 3)
    for k in range(13):
        u, p, v = flown(x0, ways.velocity[k], ways.hold[k], wind, law, first)
        assert found.u[k] == pytest.approx(u, abs=1e-9)
        assert found.p[k] == pytest.approx(p, abs=1e-9)
        assert found.v[k] == pytest.approx(v, abs=1e-9)
        after = np.arange(13) % 2 == 0
        some = simulate(x0, ways, wind, law, np.array([9.0, 0.1, 0.2, 0.3]), after)
        alone = simulate(x0, ways.one(k), wind, law, some.u[k] if after[k] else None)
        assert some.p[k] == pytest.approx(alone.p[0], abs=1e-12)
        assert some.u[k] == pytest.approx(alone.u[0], abs=1e-12)
        alone = simulate(x0, ways.one(k), wind, law, first)
        assert alone.u[0] == pytest.approx(found.u[k], abs=1e-12)
        assert alone.p[0] == pytest.approx(found.p[k], abs=1e-12)
        assert alone.v[0] == pytest.approx(found.v[k], abs=1e-12)


def test_a_drone_at_rest_stays_where_it_is():
    x0 = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    found = simulate(x0, STRAIGHT, np.zeros(3), LAW, None)
    assert found.u.tolist() == [[pytest.approx(G), 0.0, 0.0, 0.0]]
    assert found.p == pytest.approx(np.tile([1.0, 2.0, 3.0], (1, 17, 1)))
    assert not found.v.any()


def test_sides_are_eight_level_ones_that_begin_ahead_then_up_and_down():
    ways = aside(np.array([0.0, -2.0, 5.0]), 1.8, 0.8)
    assert len(ways) == 10
    level = aside(np.array([0.0, -2.0, 5.0]), 1.8, 0.8, upright=False)
    assert level.velocity.tolist() == ways.velocity[:8].tolist()
    assert level.hold.tolist() == [0.8] * 8
    assert ways.velocity[0] == pytest.approx([0.0, -1.8, 0.0])
    assert ways.velocity[1] == pytest.approx([1.8 * np.sqrt(0.5), -1.8 * np.sqrt(0.5), 0.0])
    assert ways.velocity[4] == pytest.approx([0.0, 1.8, 0.0])
    assert ways.velocity[8:].tolist() == [[0.0, 0.0, 0.8], [0.0, 0.0, -0.8]]
    assert ways.hold.tolist() == [0.8] * 10
    one = ways.one(3)
    assert (one.velocity.tolist(), one.hold.tolist()) == ([ways.velocity[3].tolist()], [0.8])


def test_what_is_left_of_a_way():
    ways = Ways(np.eye(3), np.array([0.8, 0.1, 0.0]))
    later = ways.later(0.1)
    assert later.hold.tolist() == pytest.approx([0.7, 0.0, 0.0])
    assert later.velocity.tolist() == np.eye(3).tolist()
