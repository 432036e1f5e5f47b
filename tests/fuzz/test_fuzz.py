"""A short run of every fuzzing target, on its corpus and on bytes from hypothesis."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from companion.supervision.guard import Guard, GuardInputs
from companion.supervision.guard_config import GuardConfig
from companion.types import Plan, PlanStatus
from mavlink_bridge.wire.messages import VehicleState
from tests.fuzz import mutate, targets

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("name", targets.TARGETS)
def test_every_target_accepts_its_corpus(name):
    seeds = targets.seeds(name)
    assert seeds
    for data in seeds:
        targets.TARGETS[name](data)


@pytest.mark.parametrize("name", [n for n in targets.TARGETS if n != "tick"])
@QUICK
@given(data=st.data())
def test_every_target_accepts_any_bytes(name, data):
    seed = data.draw(st.sampled_from(targets.seeds(name)))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    targets.TARGETS[name](mutate.mutate(seed, rng))
    targets.TARGETS[name](data.draw(st.binary(max_size=600)))


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32 - 1))
def test_a_tick_accepts_any_bytes(seed):
    rng = np.random.default_rng(seed)
    data = b"".join(mutate.mutate(f, rng) for f in targets.seeds("tick")) + rng.bytes(480)
    targets.tick(data)


floats = st.floats(allow_nan=True, allow_infinity=True, width=64)
vectors = st.lists(floats, min_size=4, max_size=4).map(np.array)


@QUICK
@given(*[vectors] * 5, *[floats] * 4, st.booleans(), st.booleans())
@example(*[np.full(4, 1e308)] * 5, 0.0, 0.0, 1e308, 1e308, True, False)
def test_the_guard_gives_a_finite_command_for_any_numbers(
    p, v, q, omega, u, time, age, outside, blind, usable, plausible
):
    inputs = np.tile(u, (20, 1))
    states = np.zeros((21, 10))
    plan = Plan(states, inputs, PlanStatus.SOLVED, usable, 1, *[0.0] * 5, (), 0.0)
    own = VehicleState(time, p[:3], v[:3], q, omega[:3])
    guard = Guard(GuardConfig())
    with np.errstate(all="ignore"):
        for r, o in ((plan, own), (None, own), (plan, None), (None, None)):
            verdict = guard.judge(
                GuardInputs(time, r, o, age, plausible, outside, v[0], blind, tick_gap=abs(age))
            )
            assert np.isfinite(verdict.command.omega).all()
            assert np.abs(verdict.command.omega).max() <= 3.0
            assert 2.0 <= verdict.command.c <= 20.0


@pytest.mark.row("10")
def test_no_mutated_frame_is_accepted_as_a_forgery(note):
    forged, _, longest = mutate.count_mavlink(10_000, 7)
    assert forged == 0
    assert longest <= 600
    answers, longest = mutate.count_msp(10_000, 7)
    assert answers < 10_000 * 0.03  # the checksum is an XOR: two flips of one bit cancel
    assert longest <= 300
    note("forged of 10,000 mutated frames", forged)
