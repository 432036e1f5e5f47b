"""The inputs sent: which of them act when, and what is left after they are forgotten."""

import numpy as np
import pytest

from companion.estimation.input_history import InputHistory, SentInput
from mavlink_bridge.shared.constants import GRAVITY


def numbered(n):
    """An input that is told from others by its collective acceleration [m/s²]."""
    return np.array([float(n), 0.0, 0.0, 0.0])


def history(delay=0.06, sent=3):
    """A history of inputs 1, 2, 3… sent at 0, 0.1, 0.2 s…"""
    known = InputHistory(delay)
    for n in range(sent):
        known.add(SentInput(0.1 * n, numbered(n + 1), 0.3))
    return known


def acting(known, start, end):
    """Return the number of the first input that acts, and times and numbers of the others."""
    first, later = known.acting(start, end)
    return first[0], [(acts, u[0]) for acts, u in later]


def test_a_new_history_holds_nothing():
    known = InputHistory(0.06)
    assert (known.delay, known.delay_sigma, known.epoch, len(known)) == (0.06, 0.0, 0, 0)


def test_where_nothing_was_sent_the_drone_is_taken_to_hover():
    known, hover = InputHistory(0.06), [GRAVITY, 0.0, 0.0, 0.0]
    assert known.u_last.tolist() == known.u_first.tolist() == hover
    first, later = known.acting(0.0, 0.1)
    assert first.tolist() == hover
    assert later == []


def test_the_first_and_the_last_input_are_told_apart():
    known = history()
    assert (known.u_first[0], known.u_last[0]) == (1.0, 3.0)


def test_inputs_are_listed_from_the_newest_to_the_oldest():
    assert [sent.u[0] for sent in reversed(history())] == [3.0, 2.0, 1.0]


def test_each_input_acts_a_delay_after_it_was_sent():
    assert acting(history(), 0.10, 0.25) == (1.0, [(pytest.approx(0.16), 2.0)])


def test_later_inputs_come_oldest_first():
    later = [(pytest.approx(0.16), 2.0), (pytest.approx(0.26), 3.0)]
    assert acting(history(), 0.06, 0.30) == (1.0, later)


def test_before_any_input_can_have_acted_the_oldest_one_stands_in():
    """Nobody knows what flew before; the oldest input is the best guess, and then acts itself."""
    assert acting(history(sent=1), -0.10, 0.10) == (1.0, [(pytest.approx(0.06), 1.0)])


def test_the_oldest_input_stands_in_before_several_others():
    later = [(pytest.approx(0.06), 1.0), (pytest.approx(0.16), 2.0)]
    assert acting(history(), -0.10, 0.20) == (1.0, later)


def test_an_input_that_acts_from_the_start_on_is_the_first():
    assert acting(history(delay=0.0), 0.1, 0.15) == (2.0, [])


def test_an_input_that_acts_from_the_end_on_only_does_not_act():
    assert acting(history(delay=0.0), 0.05, 0.1) == (1.0, [])


def test_the_delay_counts_as_it_is_known_now():
    known = history()
    known.delay = 0.12
    assert acting(known, 0.12, 0.25) == (1.0, [(pytest.approx(0.22), 2.0)])


def test_the_last_64_inputs_are_kept():
    known = history(sent=70)
    assert len(known) == 64
    assert (known.u_first[0], known.u_last[0]) == (7.0, 70.0)


def test_forgetting_leaves_no_input_and_begins_another_epoch():
    known = history()
    known.clear()
    assert (len(known), known.epoch, known.u_last[0]) == (0, 1, GRAVITY)
    known.clear()
    assert known.epoch == 2
    assert known.delay == 0.06
