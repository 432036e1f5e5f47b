"""Faults as data: what a scenario may say, and that the same seed breaks the same things."""

import resource
import subprocess
from typing import get_args

import numpy as np
import pytest

from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.catalogue import KINDS, Fault, FaultConfig, Kind, Schedule
from sitl_sim.faults.link import FaultyLine, FaultyTelemetry
from sitl_sim.faults.world import FaultyWorld
from sitl_sim.flight.runner import Flight, flight
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario, WireConfig
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Airframe, Vehicles

FILE_SIZE = resource.RLIMIT_FSIZE
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
def test_a_fault_that_cannot_be_is_refused(tmp_path, fault, overrides, what):
    file = tmp_path / "s.yaml"
    file.write_text(HEAD + f"faults: [{fault}]\n")
    with pytest.raises(SettingsError, match=what):
        scenarios.fault_schedule(scenarios.load(str(file), overrides))


def test_what_needs_a_process_is_refused_where_companions_have_none(tmp_path):
    faults = [{"kind": "gust"}, {"kind": "disk_full", "at": 1.0}]
    drones = {"count": 1, "heading_deg": 0.0}
    s = Scenario.model_validate({"drones": drones, "faults": faults})
    with pytest.raises(SettingsError) as caught:
        Flight(s, tmp_path, in_process=True)
    assert str(caught.value).startswith("faults.1.kind: disk_full needs companions in processes")
    wire = {"companion_port": 28740, "gcs_port": 28750, "frame_port": 28760}
    with flight(s.model_copy(update={"wire": WireConfig(**wire)}), tmp_path):
        pass


def schedule(seed=1, n=2, **fault):
    return Schedule([FaultConfig.model_validate(fault)], [f"drone{i + 1}" for i in range(n)], seed)


def test_every_kind_has_a_meaning():
    assert set(KINDS) == set(get_args(Kind))


def test_a_fault_has_its_time_and_its_drone():
    s = schedule(kind="gust", drone="drone2", at=2.0, **{"for": 1.0})
    assert [bool(s.at(1, t, "gust")) for t in (1.9, 2.0, 2.9, 3.0)] == [False, True, True, False]
    assert not s.at(0, 2.5, "gust")


@pytest.mark.parametrize(
    ("kind", "amount", "least", "most"),
    [
        ("link_loss", 0.2, 760, 840),
        ("link_duplicate", 0.2, 1160, 1240),
        ("link_reorder", 0.2, 998, 1000),
        ("link_flip", 0.2, 1000, 1000),
    ],
)
def test_what_a_line_does_is_seeded(kind, amount, least, most):
    def carried(seed):
        line = FaultyLine(schedule(seed, kind=kind, amount=amount), 0)
        return [p for n in range(1000) for p in line.carry(b"%06d" % n, to_companion=True)]

    assert carried(3) == carried(3) != carried(4)
    assert least <= len(carried(3)) <= most
    assert carried(3) != [b"%06d" % n for n in range(1000)]


def test_garbage_comes_at_its_rate_and_foreigners_are_foreign():
    line = FaultyLine(schedule(kind="link_garbage", amount=1e6), 0)
    line.carry(Codec(1, 1).encode([Heartbeat(12, 2, True, 0, 4)]), to_companion=True)
    assert sum(len(p) for _ in range(50) for p in line.noise()) == pytest.approx(1e6, rel=0.01)
    line = FaultyLine(schedule(kind="link_foreign", amount=500.0), 0)
    heard = [r for _ in range(50) for p in line.noise() for r in Codec(9, 9).decode_datagram(p)]
    assert 400 < len(heard) < 600
    assert all((r.source.system, r.source.component) != (1, 1) for r in heard)


def told(kind, n=50, **more):
    t = FaultyTelemetry(schedule(kind=kind, **more), 0)
    out = []
    for k in range(n):
        out += t.alter(
            0.02 * k,
            [
                Attitude(0.02 * k, np.array([1.0, 0, 0, 0]), np.zeros(3)),
                LocalPosition(0.02 * k, np.zeros(3), np.zeros(3)),
                Heartbeat(12, 2, True, 0, 4),
            ],
        )
    return out


def test_telemetry_faults():
    kinds = [type(m) for m in told("telemetry_stale")]
    assert set(kinds) == {Heartbeat}
    assert {type(m) for m in told("position_lost")} == {Heartbeat, Attitude}
    for m in told("telemetry_nan"):
        if isinstance(m, Attitude):
            values = np.concatenate([m.q_wb, m.omega])
            assert not np.isfinite(values).all() or (np.abs(values[values != 0]) < 1e-40).any()
    late = [m for m in told("telemetry_late", amount=0.1) if isinstance(m, Attitude)]
    assert len(late) == 45
    assert {
        round(np.linalg.norm(m.q_wb), 3)
        for m in told("quaternion", amount=0.5)
        if isinstance(m, Attitude)
    } == {0.5}


def test_what_is_no_number_is_none_on_the_wire_either():
    for m in told("telemetry_nan", n=200):
        if isinstance(m, LocalPosition):
            (heard,) = Codec(1, 1).decode(Codec(1, 1).encode([m]))
            values = np.concatenate([heard.message.p, heard.message.v])
            assert (~np.isfinite(values) | ((values != 0) & (np.abs(values) < 1e-38))).any()


def frames(kind, n=20, **more):
    c = FaultyCamera(schedule(kind=kind, **more), 0)
    rng = np.random.default_rng(0)
    row = np.array([[0.0, 0.0, 1.0, 4.0, 0.005, 0.03]])
    return [
        c.alter(
            0.1 * k,
            10 + 0.1 * k,
            {
                "neighbours": np.vstack([row, row * 0.5]),
                "image": rng.integers(40, 200, (8, 8, 3), np.uint8),
            },
        )
        for k in range(n)
    ]


def test_camera_faults():
    assert all(not arrays for _, arrays in frames("camera_dead"))
    frozen = [a["image"] for _, a in frames("camera_frozen")]
    assert all((image == frozen[0]).all() for image in frozen)
    assert {int(a["image"].max()) for _, a in frames("camera_black")} == {0}
    assert {int(a["image"].min()) for _, a in frames("camera_saturated")} == {255}
    late = [stamp for stamp, _ in frames("camera_late", amount=0.2)]
    assert late[5] == pytest.approx(10.3)
    assert all(len(a["neighbours"]) == 0 for _, a in frames("missed", amount=1.0))
    assert all(len(a["neighbours"]) == 3 for _, a in frames("ghosts", amount=1.0))
    assert frames("range_bias", amount=1.2)[0][1]["neighbours"][0, 3] == pytest.approx(4.8)


def test_what_is_laid_on_a_vehicle_is_taken_off_again():
    vehicles = Vehicles(Airframe(), np.zeros((2, 3)), 0.0)
    whole = vehicles.body.thrust_max.copy()
    s = schedule(kind="motor", drone="drone2", at=1.0, amount=0.8, **{"for": 1.0})
    world = FaultyWorld(s, vehicles, None)
    world.update(0.5)
    assert (vehicles.body.thrust_max == whole).all()
    world.update(1.0)
    assert sorted((vehicles.body.thrust_max / whole)[1].round(6)) == [0.8, 1, 1, 1]
    assert (vehicles.body.thrust_max[0] == whole[0]).all()
    world.update(2.0)
    assert (vehicles.body.thrust_max == whole).all()
    dead = FaultyWorld(schedule(kind="motor", amount=0.0, at=1.0, **{"for": 1.0}), vehicles, None)
    for t in (0.0, 1.0, 2.0):
        dead.update(t)
        assert (vehicles.body.thrust_max == 0.0).sum() == 2 * (t == 1.0)
    assert (vehicles.body.thrust_max == whole).all()
    configs = [
        {"kind": "thrust_scale", "at": float(k), "for": 2.0, "amount": a}
        for k, a in enumerate((0.5, 0.8))
    ]
    faults = [FaultConfig.model_validate(c) for c in configs]
    both = FaultyWorld(Schedule(faults, ["drone1", "drone2"], 1), vehicles, None)
    for t, share in enumerate((0.5, 0.4, 0.8, 1.0)):
        both.update(float(t))
        assert (vehicles.body.thrust_max / whole).ravel() == pytest.approx([share] * 8)
    gusts = FaultyWorld(schedule(kind="gust", amount=5.0), vehicles, None)
    wind = gusts.wind(0.0, np.array([1.0, 0.0, 0.0]))
    assert np.linalg.norm(wind - [1.0, 0, 0], axis=1) == pytest.approx([5.0, 5.0])
    assert isinstance(next(iter(s.all())), Fault)


@pytest.fixture
def victim():
    """A process whose files may be forbidden to grow; its id."""
    with subprocess.Popen(["sleep", "60"]) as process:
        yield process.pid
        process.kill()


@pytest.mark.parametrize("first", [2.0, 4.0])  # s it lasts: ends before the second, or after it
@pytest.mark.parametrize(
    ("kind", "state", "once", "both"),
    [
        ("gyro_bias", lambda a: (a.gyro_bias(0) - a.truly)[0], 0.05, 0.1),
        ("position_jump", lambda a: a.offset[0, 0], 3.0, 6.0),
        ("position_lost", lambda a: float("gps" in a.units[0].commander.failed), 1.0, 1.0),
        ("disk_full", lambda a: float(resource.prlimit(a.pid, FILE_SIZE)[0] == 0), 1.0, 1.0),
    ],
)
def test_faults_that_overlap_end_each_in_its_time(victim, kind, state, once, both, first):
    vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
    a = Autopilots(vehicles, [1])
    a.truly, a.offset, a.pid = a.gyro_bias(0), a._shared.estimate.offset, victim
    times = [{"at": 1.0, "for": first}, {"at": 2.0, "for": 2.0}]
    faults = [FaultConfig.model_validate({"kind": kind} | t) for t in times]
    world = FaultyWorld(Schedule(faults, ["drone1"], 1), vehicles, a, lambda i: victim)
    found = []
    for t in range(6):
        world.update(float(t))
        found.append(state(a))
    expected = [0.0, once, both, *([both, once] if first == 4.0 else [once, 0.0]), 0.0]
    assert found == pytest.approx(expected)


def test_a_reboot_mends_no_sensor():
    vehicles = Vehicles(Airframe(), np.zeros((1, 3)), 0.0)
    a = Autopilots(vehicles, [1])
    faults = [{"kind": "position_lost", "for": 2.0}, {"kind": "reboot", "at": 1.0}]
    configs = [FaultConfig.model_validate(f) for f in faults]
    world = FaultyWorld(Schedule(configs, ["drone1"], 1), vehicles, a)
    found = []
    for t in range(3):
        world.update(float(t))
        found.append("gps" in a.units[0].commander.failed)
    assert found == [True, True, False]
