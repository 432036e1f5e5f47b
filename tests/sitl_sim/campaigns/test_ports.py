"""Each vehicle has ports of its own, and so has each flight on a machine."""

import re
from pathlib import Path

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns import ports
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import companion_config

QUIET = 30000, 30100  # where no flight is


def _ports_of_companions(scenario):
    """The UDP port in each companion's configuration."""
    configs = [companion_config(scenario, i, Path(), False) for i in range(scenario.drones.count)]
    return [int(c["link"]["endpoint"].rpartition(":")[2]) for c in configs]


@pytest.mark.parametrize("drones", [9, 10, 20])
def test_no_companion_listens_where_ground_stations_do(drones):
    s = scenarios.load("forest", [f"drones.count={drones}"])
    assert len({*_ports_of_companions(s), s.wire.gcs_port}) == drones + 1
    assert _ports_of_companions(s)[:9] == list(range(14541, 14550))


def test_vehicles_send_to_the_ports_of_their_companions(tmp_path):
    wire = ["wire.companion_port=28540", "wire.gcs_port=28543", "wire.frame_port=28640"]
    s = scenarios.load("crossing", ["drones.count=4", "sensing.obstacles=map", *wire])
    assert _ports_of_companions(s) == [28541, 28542, 28544, 28545]
    with flight(s, tmp_path) as f:
        table = [re.findall(r"UDP (\d+)", line) for line in f.wire_table()]
        sent = [d.companion.endpoint.remote[1] for d in f._drones]
    assert table == [[str(port), "28543"] for port in _ports_of_companions(s)]
    assert sent == _ports_of_companions(s)


def _block(base, drones):
    """All ports of a block: companions, frames, the ground stations'."""
    told = dict(part.split("=") for part in ports.overrides(base, drones))
    first = {name.removeprefix("wire."): int(port) for name, port in told.items()}
    return {first["gcs_port"]} | {
        first[name] + k + 1 for name in ("companion_port", "frame_port") for k in range(drones)
    }


def test_blocks_of_ports_are_apart_and_are_used_again():
    with ports.block(3) as one, ports.block(3) as two:
        assert abs(one - two) >= 8
        asked = ports.overrides(one, 3)
    assert asked == [
        f"wire.companion_port={one}",
        f"wire.frame_port={one + 3}",
        f"wire.gcs_port={one + 7}",
    ]
    with ports.block(3) as again:
        assert again == one


def test_lock_files_of_another_user_are_locked_too(monkeypatch):
    with ports.block(3) as one:
        pass
    opened = Path.open

    def theirs(path, mode="r", *arguments, **keys):
        if mode != "r" and path.exists():
            raise PermissionError(13, "Permission denied")
        return opened(path, mode, *arguments, **keys)

    monkeypatch.setattr(Path, "open", theirs)
    with ports.block(3) as mine, ports.block(3) as other:
        assert mine == one != other


@pytest.mark.parametrize(("one", "other"), [(3, 4), (9, 10), (10, 9), (1, 40)])
def test_flights_of_any_size_at_once_share_no_port(one, other):
    with ports.block(one) as a, ports.block(other) as b, ports.block(one) as c:
        taken = [_block(a, one), _block(b, other), _block(c, one)]
    assert len(set.union(*taken)) == sum(map(len, taken)) == 2 * one + (2 * other + 1) + 2 * one + 2


def test_a_block_that_is_given_back_is_free_for_another_size():
    with ports.block(2, *QUIET) as small:
        pass
    with ports.block(12, *QUIET) as large:
        assert large == small


def test_no_free_block_is_an_error():
    first, _ = QUIET
    with ports.block(3, first, first + 24) as base:
        assert base == first
        with (
            pytest.raises(SettingsError, match="no 18 free ports"),
            ports.block(8, first, first + 24),
        ):
            pass
