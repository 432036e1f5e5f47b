"""Schedules of one fault."""

import pytest

from sitl_sim.faults.catalogue import FaultConfig, Schedule


@pytest.fixture
def schedule():
    """schedule(seed, n, **fault): the schedule of one fault in a flight of n drones."""

    def make(seed=1, n=2, **fault):
        names = [f"drone{i + 1}" for i in range(n)]
        return Schedule([FaultConfig.model_validate(fault)], names, seed)

    return make
