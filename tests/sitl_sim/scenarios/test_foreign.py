"""Foreign drones in a scenario: what they may be, and what is refused with its key."""

import re

import pytest
import yaml

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.flight.inputs import whose_targets
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import check_companions, companion_config


def loaded(foreign, *overrides):
    return scenarios.load("crossing", [f"drones.foreign={foreign}", *overrides])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["drone11.does=hover"], "drones.foreign: no drone 'drone11'; valid: drone1, drone2, "),
        (["drone2.speed=1.0"], "drones.foreign.drone2.does: is missing"),
        (["drone2.does=hover", "drone2.speed=1.0"], "drone2.speed: belongs to does: straight, p"),
        (["drone2.does=orca", "drone2.speed=1.0"], "drone2.speed: belongs to does: straight, p"),
        (["drone2.does=straight", "drone2.speed=0.0"], "drone2.speed: must be > 0, ≤ 10"),
        (["drone2.does=straight", "drone2.after=1.0"], "drone2.after: belongs to does: pursue"),
    ],
)
def test_what_no_foreign_drone_can_be_is_refused(settings, words):
    with pytest.raises(SettingsError, match=re.escape(words)):
        scenarios.load("crossing", [f"drones.foreign.{s}" for s in settings])


def test_a_flight_needs_a_drone_of_ours():
    with pytest.raises(SettingsError, match="one drone at least must be ours"):
        scenarios.load("circle", ["drones.count=1", "drones.foreign={drone1: {does: hover}}"])


@pytest.mark.parametrize("autopilot", ["autopilot=betaflight", "binary=px4"])
def test_real_autopilots_have_no_foreign_drones(autopilot):
    with pytest.raises(SettingsError, match=r"drones\.foreign.*needs emulated autopilots"):
        loaded("{drone2: {does: hover}}", f"drones.{autopilot}")


def test_what_a_drone_does_is_a_pilot_or_a_controller():
    check_companions(loaded("{drone2: {does: hover}, drone3: {does: rbl}}"), True)
    words = "drones.foreign.drone2.does: no controller 'dance'; valid: nmpc, "
    with pytest.raises(SettingsError, match=rf"{re.escape(words)}.*; or hover, straight, pursue$"):
        check_companions(loaded("{drone2: {does: dance}}"), True)


def test_a_controllers_companion_flies_with_it_alone(tmp_path):
    s = loaded("{drone10: {does: rbl}, drone2: {does: pursue}}", "companion.controller=orca")
    assert companion_config(s, 9, tmp_path, clock=False)["controller"] == "rbl"
    assert companion_config(s, 0, tmp_path, clock=False)["controller"] == "orca"
    assert scenarios.controllers(s) == {"orca", "rbl"}
    assert "drone2" not in scenarios.companion_names(s)
    assert "drone10" in scenarios.companion_names(s)


def test_the_world_names_the_foreign_ones_by_number_and_has_no_targets_of_theirs():
    s = loaded("{drone10: {does: rbl}, drone2: {does: pursue}}")
    world = whose_targets(s, placement.starts(s))
    assert world["foreign"] == ["drone2", "drone10"]
    assert set(world["targets"]) == {f"drone{n}" for n in (1, 3, 4, 5, 6, 7, 8, 9)}
    without = scenarios.load("crossing", [])
    assert "foreign" not in whose_targets(without, placement.starts(without))


def test_what_is_written_into_the_run_folder_is_read_again(tmp_path):
    s = loaded("{drone2: {does: straight}, drone3: {does: pursue, after: 3.0}}")
    file = tmp_path / "scenario.yaml"
    file.write_text(yaml.safe_dump(s.model_dump()))
    again = scenarios.load(str(file), [])
    assert again == s
    assert again.drones.foreign["drone2"].fastest == 2.0
    assert again.drones.foreign["drone3"].begins == 3.0
