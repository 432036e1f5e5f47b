"""`companion fleet` towards vehicles that obey signed commands alone."""

import json
import socket
import threading
from datetime import UTC, datetime

from pymavlink.dialects.v20 import common

from companion.__main__ import main
from companion.ground.signed_fleet import SignedAction
from companion.ground.station import Station
from mavlink_bridge.wire.udp import UdpEndpoint
from tests.companion.deployment import write_drones
from tests.companion.ground.emulated import Emulated, config
from tests.companion.patience import PATIENCE

KEY = bytes(range(32))
EPOCH = datetime(2015, 1, 1, tzinfo=UTC)
ARM, LANDED = 400, 1  # MAV_CMD_COMPONENT_ARM_DISARM, MAV_LANDED_STATE_ON_GROUND


class PymavlinkVehicle:
    """A disarmed PX4 of pymavlink's on a UDP line: it signs, and drops what is not signed."""

    def __init__(self, port, key=KEY):
        self.refused, self.commands, self.armed = 0, [], False
        self._mav = common.MAVLink(self, srcSystem=1, srcComponent=1)
        signing = self._mav.signing
        signing.secret_key, signing.sign_outgoing = key, True
        # 10 µs since 2015
        signing.timestamp = round((datetime.now(UTC) - EPOCH).total_seconds() * 1e5)
        self._port, self._end = port, threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.1)
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()
        self._socket.close()

    def write(self, data):
        """Send, as pymavlink's file."""
        self._socket.sendto(bytes(data), ("127.0.0.1", self._port))

    def _run(self):
        while not self._end.is_set():
            mode = 0x80 if self.armed else 0
            self._mav.heartbeat_send(2, 12, mode, 0x03040000, 3)
            self._mav.extended_sys_state_send(0, LANDED)
            try:
                data = self._socket.recv(2048)
            except TimeoutError:
                continue
            try:
                heard = self._mav.parse_buffer(data) or []
            except common.MAVError:  # "Invalid signature"
                self.refused += 1
                continue
            for m in heard:
                self._obey(m)

    def _obey(self, m):
        if m.get_type() != "COMMAND_LONG":
            return
        self.commands.append((m.get_srcSystem(), m.get_srcComponent(), m.command, m.get_signed()))
        if m.command == ARM:
            self.armed = m.param1 == 1
            self._mav.command_ack_send(ARM, 0)


def key_file(path, key=KEY):
    path.touch(0o600)
    path.write_text(key.hex())
    return path


def signing_drones(folder, **keys):
    """Write drones that sign with these files of keys; None: one that does not."""
    write_drones(folder, list(keys))
    for name, key in keys.items():
        if key is not None:
            file = folder / f"{name}.yaml"
            file.write_text(
                file.read_text().replace("link: {", f"link: {{signing: {{key: '{key}'}}, ")
            )
    return folder


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def fleet(action, drones, port, *more):
    url = f"udpin://127.0.0.1:{port}"
    return main(["fleet", action, "--all", "--drones", str(drones), "--url", url, "--json", *more])


def test_a_vehicle_of_pymavlinks_that_obeys_signed_commands_alone_arms(tmp_path, capsys):
    """Pymavlink, not this project, says that the signature is the key's."""
    drones = signing_drones(tmp_path, one=key_file(tmp_path / "key"))
    port = free_port()
    with PymavlinkVehicle(port) as vehicle:
        status = fleet("arm", drones, port, "--patience", str(PATIENCE))
    (row,) = json.loads(capsys.readouterr().out)
    assert (status, row["result"], row["armed"], row["mode"]) == (0, "done", True, "hold")
    assert vehicle.refused == 0
    assert {signed for *_, signed in vehicle.commands} == {True}
    assert (245, 190, ARM, True) in vehicle.commands


def test_with_another_key_the_vehicle_is_not_found_and_hears_nothing(tmp_path, capsys):
    """`--signing-key` goes before the file that the drone names."""
    drones = signing_drones(tmp_path, one=key_file(tmp_path / "key"))
    other = key_file(tmp_path / "other", bytes(32))
    port = free_port()
    with PymavlinkVehicle(port) as vehicle:
        options = ("--patience", "1", "--signing-key", str(other))
        assert fleet("arm", drones, port, *options) == 1
    assert json.loads(capsys.readouterr().out)[0]["result"] == "not found"
    assert not vehicle.commands
    assert not vehicle.armed


def act(world, action, until=30.0):
    """Return the rows, by drone, of an action of a world's vehicles."""
    told = SignedAction(action, world.configs, world.station, world.now + until)
    for _ in range(2000):
        world.step()
        if told.step(world.now):
            return {row.drone: row for row in told.rows.values()}
    raise AssertionError(told.rows)


def test_signing_vehicles_arm_take_off_hold_and_land():
    world = Emulated(2, key=KEY)
    assert all(row.ok and row.armed for row in act(world, "arm").values())
    assert all(row.ok for row in act(world, "takeoff").values())
    for _ in range(400):
        world.step()
    rows = act(world, "status")
    assert [(r.ok, r.mode, r.height > 1.0) for r in rows.values()] == [(True, "hold", True)] * 2
    assert all(90 < r.battery_percent <= 100 for r in rows.values())
    start = act(world, "start")["drone1"]  # nobody streams setpoints here
    assert not start.ok
    assert start.result.startswith("refused (temporarily rejected): armed, mode hold")
    assert [r.mode for r in act(world, "land").values()] == ["land"] * 2


def test_no_drone_waits_for_one_that_is_not_there():
    world = Emulated(2, key=KEY)
    world.cut.add(0)
    told = SignedAction("arm", world.configs, world.station, until=1e9)
    for _ in range(500):
        world.step()
        assert not told.step(world.now)
    assert (told.rows[2].ok, told.rows[2].armed) == (True, True)
    assert told.rows[1].result == "not found"
    assert act(world, "land", until=0.0)["drone1"].result == "not found"


def test_keys_that_do_not_fit_are_one_line_with_the_drones_place(tmp_path, capsys):
    one, two = key_file(tmp_path / "1.key"), key_file(tmp_path / "2.key", bytes(32))
    for n, (second, said) in enumerate(
        [
            (None, "link.signing: not set, as it is for others: --only those that sign"),
            (two, "link.signing: another key than other drones have: --only those with one"),
            (tmp_path / "none", f"{tmp_path / 'none'}: cannot be read: No such file or directory"),
        ]
    ):
        folder = tmp_path / str(n)
        folder.mkdir()
        assert fleet("arm", signing_drones(folder, a=one, b=second), free_port()) == 2
        told = capsys.readouterr().err
        assert told.startswith(str(folder / "b.yaml"))
        assert said in told
        assert len(told.splitlines()) == 1


def test_a_url_that_the_station_cannot_open_is_told(tmp_path, capsys):
    drones = signing_drones(tmp_path, one=key_file(tmp_path / "key"))
    command = ["fleet", "arm", "--all", "--drones", str(drones), "--url", "tcpin://0.0.0.0:1"]
    assert main(command) == 2
    assert "--url endpoint 'tcpin:0.0.0.0:1' is none of: udpin:" in capsys.readouterr().err


def test_a_vehicle_that_waits_for_its_ground_station_is_spoken_to_first():
    """`udpout`: nobody else begins."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        endpoint = UdpEndpoint(remote=vehicle.getsockname())
        Station([config()], endpoint, 245).step(0.0)
        endpoint.close()
        vehicle.settimeout(PATIENCE)
        assert vehicle.recv(100)[:10] == bytes([0xFD, 9, 0, 0, 0, 245, 190, 0, 0, 0])  # HEARTBEAT
