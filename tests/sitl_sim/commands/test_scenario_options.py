"""Options that several commands share: what they change in a scenario."""

import argparse

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.commands.scenario_options import add_scenario_arguments, overrides
from sitl_sim.scenarios.scenario import load


def flown(*words):
    parser = argparse.ArgumentParser()
    add_scenario_arguments(parser)
    options = parser.parse_args(words)
    return load(options.scenario, overrides(options))


@pytest.mark.parametrize(
    ("scenario", "obstacles"), [("forest", "network"), ("crossing", "network"), ("tunnel", None)]
)
def test_bare_drones_in_a_drawn_look_are_seen_by_the_networks(scenario, obstacles):
    s = flown(scenario, "--bare")
    assert (s.world.look, s.drones.look) == ("random", "bare")
    sensing = s.companion["sensing"]
    assert sensing["detector"] == "network"
    assert sensing.get("obstacles") == obstacles  # a wall with an opening needs its depth camera


def test_keys_come_last_and_the_scenario_may():
    keys = "--set", "world.look=pine", "--set", "drones.look=mixed"
    s = flown("--drones", "3", *keys, "--bare", "forest")
    assert (s.world.look, s.drones.look, s.drones.count) == ("pine", "mixed", 3)


def test_without_it_nothing_changes():
    assert flown("forest") == load("forest", [])


def test_a_look_that_shows_no_bare_drones_is_refused():
    with pytest.raises(SettingsError, match="plain"):
        flown("forest", "--bare", "--set", "world.look=plain")
