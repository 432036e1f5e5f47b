"""Faults as data: what a scenario may contain, and when a fault is present."""

from typing import get_args

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.faults.catalogue import KINDS, Kind
from sitl_sim.flight.runner import Flight, flight
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario, WireConfig

HEAD = "fileversion: 1\nsensing: {neighbours: truth}\ndrones: {count: 2}\n"


WRONG = [
    ("faults: [{kind: link_los}]\n", "4:11", "faults.0.kind: must be 'link_loss', "),
    ("faults: [{kind: gust, when: 3}]\n", "4:23", "faults.0.when: unknown key; valid: amount, "),
    ("faults: [{kind: gust, for: -1}]\n", "4:23", "faults.0.for: must be > 0, got -1"),
    (
        "faults: [{kind: link_loss, amount: 20}]\n",
        "4:28",
        "link_loss takes 0…1 (share of MAVLink packets lost, each way), got 20",
    ),
    ("faults: [{kind: kill, amount: 1}]\n", "4:23", "kill takes none"),
    ("faults: [{kind: mode}]\n", "4:11", "belongs to kind mode: hold, land, "),
    ("faults: [{kind: gust, to: hold}]\n", "4:23", "belongs to kind mode"),
    ("faults: [{}]\n", "4:10", "faults.0.kind: is missing"),
]


@pytest.mark.parametrize(("text", "place", "what"), WRONG)
def test_a_wrong_fault_is_named_with_its_place(tmp_path, text, place, what):
    file = tmp_path / "s.yaml"
    file.write_text(HEAD + text)
    with pytest.raises(SettingsError) as caught:
        scenarios.load(str(file), [])
    assert caught.value.problems[0].startswith(f"{file}:{place}: ")
    assert what in caught.value.problems[0]


@pytest.mark.parametrize(
    ("fault", "overrides", "what"),
    [
        ("{kind: gust, drone: drone3}", [], "no drone 'drone3'; valid: all, drone1, drone2"),
        ("{kind: reboot}", ["drones.autopilot=betaflight"], "reboot needs an emulated autopilot"),
        ("{kind: camera_black}", ["sensing.obstacles=map"], "camera_black needs a camera"),
        ("{kind: ghosts}", ["sensing.neighbours=camera"], "needs sensing.neighbours: truth"),
    ],
)
def test_an_impossible_fault_is_refused(tmp_path, fault, overrides, what):
    file = tmp_path / "s.yaml"
    file.write_text(HEAD + f"faults: [{fault}]\n")
    with pytest.raises(SettingsError, match=what):
        scenarios.fault_schedule(scenarios.load(str(file), overrides))


def test_a_fault_of_processes_is_refused_for_companions_without_processes(tmp_path):
    faults = [{"kind": "gust"}, {"kind": "disk_full", "at": 1.0}]
    drones = {"count": 1, "heading_deg": 0.0}
    s = Scenario.model_validate({"drones": drones, "faults": faults})
    with pytest.raises(SettingsError) as caught:
        Flight(s, tmp_path, in_process=True)
    assert str(caught.value).startswith("faults.1.kind: disk_full needs companions in processes")
    wire = {"companion_port": 28740, "gcs_port": 28750, "frame_port": 28760}
    with flight(s.model_copy(update={"wire": WireConfig(**wire)}), tmp_path):
        pass


def test_every_kind_has_a_meaning():
    assert set(KINDS) == set(get_args(Kind))


def test_a_fault_has_its_time_and_its_drone(schedule):
    s = schedule(kind="gust", drone="drone2", at=2.0, **{"for": 1.0})
    assert [bool(s.at(1, t, "gust")) for t in (1.9, 2.0, 2.9, 3.0)] == [False, True, True, False]
    assert not s.at(0, 2.5, "gust")


def test_a_schedule_tells_whether_a_drone_ever_has_a_fault(schedule):
    timed = schedule(kind="camera_frozen", drone="drone2", at=4.0)
    assert timed.has(1, "camera_late", "camera_frozen")
    assert not timed.has(1, "camera_late")
    assert not timed.has(0, "camera_frozen")
