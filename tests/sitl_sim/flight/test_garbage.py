"""The collector is spared during a flight and as before after it."""

import gc

import pytest

from sitl_sim.flight.garbage import spared_collector

USUAL = (700, 10, 10)


@pytest.fixture(autouse=True)
def usual():
    """The collector as Python starts with it, whatever flew in this process before."""
    before = gc.get_threshold()
    gc.unfreeze()
    gc.set_threshold(*USUAL)
    yield
    gc.set_threshold(*before)


def test_what_was_there_before_a_flight_is_not_searched_until_its_end():
    with spared_collector():
        assert gc.get_freeze_count() > 1000
        assert gc.get_threshold()[0] > USUAL[0]
    assert gc.get_threshold() == USUAL
    assert gc.get_freeze_count() == 0


def test_a_flight_that_fails_gives_the_collector_back():
    with pytest.raises(RuntimeError), spared_collector():
        raise RuntimeError
    assert gc.get_threshold() == USUAL
    assert gc.get_freeze_count() == 0
