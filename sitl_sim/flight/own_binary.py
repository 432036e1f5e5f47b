"""Which program flies the vehicles of a scenario that names a SITL binary of the user's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sitl_sim.external.airframe_parameters import ardupilot_parameters, px4_parameters
from sitl_sim.external.ardupilot_json import ArdupilotSitl
from sitl_sim.external.external_sitl import ExternalError, ExternalSitl
from sitl_sim.external.hil_sensors import HilSensors
from sitl_sim.external.px4_hil import Px4Sitl
from sitl_sim.scenarios.scenario import DronesConfig, Scenario
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.worlds.geodesy import LocalFrame

# What a deployer sets before a companion flies that autopilot: thrust is thrust; a PX4 whose
# companion dies lands, where by default it climbs to 30 m and returns.
_NEEDED = {"ardupilot": {"GUID_OPTIONS": 8.0}, "px4": {"COM_OBL_RC_ACT": 4.0}}
# A real ArduCopter goes on at the last rates and thrust until then: 3 s by default, to the ground.
_SAFE = {"ardupilot": {"GUID_TIMEOUT": 0.5}}


def boot_parameters(scenario: Scenario) -> dict[str, float]:
    """Return the autopilot parameters at boot: what a companion needs, then the scenario's."""
    return _NEEDED.get(scenario.drones.autopilot, {}) | scenario.drones.parameters


def real_parameters(scenario: Scenario) -> dict[str, float]:
    """Return the parameters of a real autopilot at boot, but for those of its airframe."""
    return _SAFE.get(scenario.drones.autopilot, {}) | boot_parameters(scenario)


def own_path(drones: DronesConfig) -> Path:
    """Return the path of the user's binary.

    Raises:
        ExternalError: there is no such file.
    """
    path = Path(drones.binary).expanduser().resolve()
    if not path.is_file():
        raise ExternalError(f"drones.binary: {drones.binary}: no such file")
    return path


def own_binary(
    scenario: Scenario,
    folders: Sequence[Path],
    frames: Sequence[LocalFrame],
    airframes: Sequence[Airframe],
    clock: Sequence[float],
) -> Callable[[int], ExternalSitl]:
    """Return a function that starts the binary for vehicle i.

    folders: of the drones. frames: their own. clock: what their clocks show at their start [s].

    Raises:
        ExternalError: the binary is missing.
    """
    binary = own_path(scenario.drones)
    wanted = real_parameters(scenario)

    def px4(i: int) -> ExternalSitl:
        sensors = HilSensors(frames[i], (scenario.seed, 0x417, i))
        parameters = px4_parameters(airframes[i]) | wanted
        return Px4Sitl(str(binary), folders[i] / "px4", i + 1, parameters, sensors, clock[i])

    def ardupilot(i: int) -> ExternalSitl:
        parameters = ardupilot_parameters(airframes[i]) | wanted
        folder = folders[i] / "ardupilot"
        return ArdupilotSitl(str(binary), folder, i + 1, parameters, frames[i], clock[i])

    return px4 if scenario.drones.autopilot == "px4" else ardupilot
