"""One tick as the log's plain data: state, detections, decisions and their reasons."""

import dataclasses

import orjson
import pytest

from companion.estimation.vehicle import VehicleEstimate
from companion.flightlog.record import encode, record
from companion.perception.camera_health import CameraFault
from companion.supervision.supervision import Supervised
from companion.tick import Tick
from companion.types import Phase
from tests.companion.ticks import COSTS, tick


def test_the_reference_and_its_reasons():
    r = record(tick(3)[1])
    assert r["goal"]["index"] == 0
    assert r["goal"]["p"] == [1.0, 2.0, 3.0]
    assert r["aim"] == [1.0, 3.0, 3.0]
    assert r["target"] == [1.5, 3.0, 3.0]  # the goal as the solver gets it
    assert r["route"] == ("detour", "right of way")
    assert (r["speed"], r["speed_limit"], r["v_max"]) == (1.2, "headway", 1.8)
    assert r["yaw"] == 0.3
    assert r["critical"] == [[0, 0.5], [1, 0.5], [2, 0.5]]


def test_the_reason_for_which_a_drone_does_not_fly():
    _, made = tick(3)
    blind = dataclasses.replace(
        made,
        seen=dataclasses.replace(made.seen, fault=CameraFault.FROZEN),
        supervised=Supervised(Phase.WAIT, inhibit_reason="64×48 px instead of 64×64"),
    )
    r = record(blind)
    assert (r["phase"], r["camera"]) == ("wait", "frozen")
    assert r["inhibit"] == "64×48 px instead of 64×64"
    assert "command" not in r


def test_the_first_tick_has_no_state_and_no_plan():
    r = orjson.loads(encode(Tick(0.0), {}, {}))
    assert (r["phase"], r["camera"], r["inhibit"]) == ("wait", "none", "")
    assert r["critical"] == r["tracks"] == r["detections"] == r["cylinders"] == []
    assert not {"own", "goal", "target", "plan", "command"} & set(r)
    assert r["frame"] is None


def test_the_costs_of_a_tick():
    r = orjson.loads(encode(tick(3)[1], {"deadline_misses": 1}, COSTS))
    assert r["stages_ms"] == {"see": 4.0, "plan": 10.0, "tick": 20.0, "log": 1.0}
    assert r["counters"] == {"deadline_misses": 1, "stamps_ahead": 0}


def test_own_state_in_the_drones_frame():
    _, made = tick(3)
    r = record(made)
    assert r["own"]["p"] == pytest.approx(made.vehicle.state.p, abs=1e-4)
    assert r["own"]["q"] == [1.0, 0.0, 0.0, 0.0]
    assert "own" not in record(dataclasses.replace(made, vehicle=VehicleEstimate()))
