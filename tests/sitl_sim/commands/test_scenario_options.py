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


@pytest.mark.parametrize("scenario", ["forest", "crossing", "tunnel"])
def test_balls_in_the_plain_look_are_found_by_colour(scenario):
    s = flown(scenario, "--balls")
    assert (s.world.look, s.drones.look, s.sensing.eyes) == ("plain", "ball", "color")


def test_keys_come_last_and_the_scenario_may():
    keys = "--set", "world.look=pine", "--set", "drones.look=mixed"
    s = flown("--drones", "3", *keys, "--balls", "forest")
    assert (s.world.look, s.drones.look, s.drones.count) == ("pine", "mixed", 3)


def test_without_it_nothing_changes():
    assert flown("forest") == load("forest", [])


def test_a_look_that_shows_no_bare_drones_is_refused():
    with pytest.raises(SettingsError, match="balls only: --balls"):
        flown("forest", "--set", "world.look=plain")
