"""The pilot's commands from a ground station: MAVSDK, real vehicles on the wire, one companion."""

import asyncio
import json
import socket
from unittest.mock import AsyncMock, MagicMock

import pytest

from companion.__main__ import main
from companion.ground import fleet as commands
from companion.settings.config import CompanionConfig
from tests.companion.deployment import write_drones
from tests.companion.patience import PATIENCE


@pytest.fixture
def fleet(world, tmp_path, capfd):
    """`companion fleet ACTION` for the drones of the world; the exit status and the rows."""
    drones = tmp_path / "drones"
    drones.mkdir()
    for i in (1, 2, 3):
        text = world.config(i).read_text().replace("auto: false", "auto: false, land: false")
        (drones / f"drone{i}.yaml").write_text(text)
    url = f"udpin://127.0.0.1:{world.ground_port}"

    def command(action, *who):
        status = main(
            [
                "fleet",
                action,
                *(who or ("--all",)),
                "--drones",
                str(drones),
                "--url",
                url,
                "--json",
                "--patience",
                "10",
            ]
        )
        told = capfd.readouterr()
        return status, json.loads(told.out) if told.out else told.err

    command.drones = drones
    return command


def test_arm_take_off_start_hold_land(fleet, start_daemon):
    companion = start_daemon(fleet.drones / "drone1.yaml")
    assert companion.listen(PATIENCE, until="READY=1"), companion.log()
    companion.until_phase("wait")  # told a moment after READY

    both = ("--only", "drone1", "drone2")
    status, rows = fleet("arm", *both)
    assert status == 0
    assert [(r["drone"], r["armed"]) for r in rows] == [("drone1", True), ("drone2", True)]
    assert fleet("takeoff", *both)[0] == 0
    companion.listen(8.0)
    status, rows = fleet("status", *both)
    assert all(r["mode"] == "hold" and 1.5 < r["height"] < 3.0 for r in rows), rows

    status, rows = fleet("start", "--only", "drone1")
    assert (status, rows[0]["mode"]) == (0, "offboard")
    companion.until_phase("fly")
    assert fleet("hold", *both)[0] == 0
    companion.until_phase("passive")  # and it never takes control back
    status, rows = fleet("land", *both)
    assert status == 0
    assert [r["mode"] for r in rows] == ["land", "land"]


def test_a_refusal_is_told_in_the_vehicles_own_words(fleet):
    assert fleet("land", "--only", "drone3")[0] == 0  # it is on the ground, disarmed
    status, rows = fleet("arm", "--only", "drone3")
    assert (status, rows[0]["ok"], rows[0]["armed"]) == (1, False, False)
    said = "Arming denied: Resolve system health failures first"[:50]  # of a STATUSTEXT
    assert rows[0]["result"] == f"refused (COMMAND_DENIED): disarmed, mode land; it says: {said}"


def test_a_mode_that_is_acknowledged_and_not_entered_is_told(fleet):
    assert fleet("hold", "--only", "drone3")[0] == 0
    assert fleet("arm", "--only", "drone3")[0] == 0
    status, rows = fleet("start", "--only", "drone3")  # no companion: no setpoints
    assert (status, rows[0]["ok"], rows[0]["mode"]) == (1, False, "hold")
    assert rows[0]["result"].startswith("accepted, but not in offboard")


def test_a_drone_that_is_not_there_has_a_row(fleet):
    text = (fleet.drones / "drone1.yaml").read_text()
    other = text.replace("drone1", "ghost").replace("system_id: 1", "system_id: 77")
    for port in range(20000, 65536):
        other = other.replace(f":{port}'", f":{port - 9000}'")
    (fleet.drones / "ghost.yaml").write_text(other)
    status, rows = fleet("status", "--only", "ghost", "--patience", "0.5")
    assert status == 1
    assert rows[0] == {
        "drone": "ghost",
        "system": 77,
        "result": "not found",
        "ok": False,
        "armed": None,
        "mode": "",
        "height": None,
        "battery_percent": None,
    }


def test_no_drone_waits_for_one_that_is_not_there(monkeypatch):
    """Drone 2 is looked for until drone 1 has been told to hold."""
    told = asyncio.Event()
    monitor = AsyncMock()
    monitor.__aenter__.return_value = monitor
    monitor.shows.return_value = True

    async def find(mavsdk, wanted, deadline):
        if wanted == 1:
            return "vehicle 1"
        await told.wait()
        return None

    async def do(action, drone, system):
        assert (action, drone.name, system) == ("hold", "drone1", "vehicle 1")
        told.set()

    stand_ins = {
        "Mavsdk": MagicMock(),
        "VehicleMonitor": lambda *_: monitor,
        "_find": find,
        "_do": do,
        "_state": AsyncMock(),
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(f"companion.ground.fleet.{name}", stand_in)
    commands.Mavsdk.return_value.__aenter__.return_value = AsyncMock()
    drones = [
        CompanionConfig.model_validate({"name": f"drone{n}", "link": {"system_id": n}})
        for n in (1, 2)
    ]
    act = commands.act("hold", drones, "udpin://127.0.0.1:0", 1e9)
    rows = asyncio.run(asyncio.wait_for(act, 10.0))
    assert [(r.ok, r.result) for r in rows] == [(True, "done"), (False, "not found")]


def test_a_url_that_cannot_be_opened(tmp_path, capsys):
    """No such URL, and a port that a ground station holds: one line each."""
    write_drones(tmp_path, ["one"])
    arguments = ["fleet", "status", "--all", "--drones", str(tmp_path), "--url"]
    assert main([*arguments, "nonsense"]) == 2
    told = capsys.readouterr().err
    assert "--url nonsense: Connection failed: CONNECTION_URL_INVALID; valid: udpin://" in told
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("0.0.0.0", 0))
        url = f"udpin://0.0.0.0:{other.getsockname()[1]}"
        assert main([*arguments, url]) == 2
    told = capsys.readouterr().err
    assert f"--url {url}: Connection failed: BIND_ERROR" in told
    assert "no other program may hold it" in told


def test_a_name_that_is_not_there(fleet):
    status, said = fleet("land", "--only", "drone9")
    assert status == 2
    assert "no drone 'drone9'; valid: drone1, drone2, drone3" in said
