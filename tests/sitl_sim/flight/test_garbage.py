"""The collector is spared during a flight and as before after it."""

import gc

import pytest

from sitl_sim.flight.garbage import spared_collector


def test_what_was_there_before_a_flight_is_not_searched_until_its_end():
    gc.unfreeze()  # other tests' hosts
    before = gc.get_threshold(), 0
    with spared_collector():
        assert gc.get_freeze_count() > 1000
        assert gc.get_threshold()[0] > before[0][0]
        assert gc.isenabled()
    assert (gc.get_threshold(), gc.get_freeze_count()) == before


def test_a_flight_that_fails_gives_the_collector_back():
    before = gc.get_threshold()
    with pytest.raises(RuntimeError), spared_collector():
        raise RuntimeError
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0
