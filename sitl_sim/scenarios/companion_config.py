"""Configuration of each companion: its ports and goals, nothing about the other drones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mavlink_bridge.shared.parts import PartError
from mavlink_bridge.shared.settings import SettingsError, overlay, parse_yaml, validate
from sitl_sim.external.fleet import BRIDGE_DELAY, EXPONENT, HOVER
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_entry_points import companion_class
from sitl_sim.scenarios.foreign import PILOTS
from sitl_sim.scenarios.scenario import Scenario, WireConfig
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

KEY_FILE = "signing.key"  # beside config.yaml
_IN_SIGHT = 10.0  # m, to which a ball is surely found: such drones see another before they set out


def companion_port(wire: WireConfig, system: int) -> int:
    """Return the UDP port of vehicle `system`'s companion; the ground stations' is left out."""
    port = wire.companion_port + system
    return port + (wire.companion_port < wire.gcs_port <= port)


def companion_config(
    scenario: Scenario,
    i: int,
    folder: Path,
    clock: bool,
    link: Mapping[str, Any] | None = None,
    frame: LocalFrame | None = None,
) -> dict[str, Any]:
    """Return the config.yaml of drone i's companion; goals are in its own frame.

    folder: run folder, for its log. clock: its ticks are paced by its clock, else by frames. link,
    frame: of the vehicle, where they are not as the scenario says.
    """
    s, wire, name = scenario, scenario.wire, scenarios.drone_names(scenario)[i]
    start = placement.starts(s)
    own = frame or LocalFrame(start[i], float(placement.frame_yaws(s)[i]), GeoReference())
    apart = np.linalg.norm(np.delete(start, i, axis=0)[:, :2] - start[i, :2], axis=1)
    goals = [own.point(np.array(g)) for g in placement.targets(s, start)[name]]
    config: dict[str, Any] = {
        "fileversion": 2,
        "name": name,
        "link": {
            "endpoint": f"udpin:{wire.host}:{companion_port(wire, i + 1)}",
            "system_id": i + 1,
            "autopilot": s.drones.autopilot,
            **(link or {}),
        },
        "camera": {
            "source": f"sim:{wire.host}:{wire.frame_port + i + 1}",
            "width": s.sensing.width,
            "height": s.sensing.height,
            "fov_deg": s.sensing.fov_deg,
            "calibration": s.sensing.calibration and str(Path(s.sensing.calibration).resolve()),
        },
        "sensing": _sensing(s),
        "timing": {"pace": "clock" if clock else "frames"},
        "gaze": {"seed": int(np.random.SeedSequence([s.seed, i]).generate_state(1)[0])},
        "mission": {
            "goals": [[round(float(a), 4) for a in g] for g in goals],
            "tolerance": round(s.mission.tolerance * 0.9, 4),
            "takeoff_altitude": s.mission.altitude,
            "level": round(float(placement.levels(s)[i]), 4),
            "auto": True,
            "others": bool((apart < _IN_SIGHT).any()),
        },
        "log": {"path": str((folder / "drones" / name / "flight.mcap").resolve())},
    }
    if s.drones.signing:
        key = (folder / "drones" / name / KEY_FILE).resolve()
        config["link"]["signing"] = {"key": str(key)}
    if s.drones.airframes:
        airframe = s.drones.airframe(i)
        config["airframe"] = {
            "radius": airframe.radius,
            "hover_thrust": round(airframe.hover_thrust, 3),
        }
    # Any of them may be the neighbour, and nobody says which.
    largest = max(s.drones.airframe(other).radius for other in range(s.drones.count))
    config["certificate"] = {"neighbour_radius": largest}
    if s.drones.autopilot == "betaflight":
        config["airframe"] = {"hover_thrust": HOVER, "thrust_exponent": EXPONENT}
        config["timing"]["delay"] = BRIDGE_DELAY
    overlay(config, s.companion)
    if name in s.drones.foreign:
        config["controller"] = s.drones.foreign[name].does
    return config


def _sensing(scenario: Scenario) -> dict[str, str]:
    """Return by what a companion finds neighbours and obstacles."""
    s = scenario.sensing
    by_network = s.eyes == "network"
    found = {
        "neighbours": s.neighbours,
        "obstacles": "network" if by_network and s.obstacles == "camera" else s.obstacles,
    }
    return {**found, "detector": s.eyes} if by_network and s.neighbours == "camera" else found


def check_companions(scenario: Scenario, in_process: bool) -> None:
    """Check the companions' configurations before anything flies.

    Raises:
        SettingsError: with every mistake of the first wrong one; a foreign drone does what no
            pilot and no controller does; or companions in this process cannot fly autopilots that
            keep their own time.
    """
    if in_process and scenario.drones.own_time:
        raise SettingsError(["a Betaflight talks to companions in processes: no --in-process"])
    model = companion_class("settings")
    flown = scenarios.companion_names(scenario)
    for name in scenarios.foreign_names(scenario):
        if name in flown:
            _check_controller(model, name, scenario.drones.foreign[name].does)
    for i, drone in enumerate(scenarios.drone_names(scenario)):
        if drone not in flown:
            continue
        file = f"drones/{drone}/config.yaml"  # as a run folder would have it
        config = yaml.safe_dump(companion_config(scenario, i, Path(), clock=True), sort_keys=False)
        validate(model, parse_yaml(config, file), file)


def _check_controller(model: Any, name: str, does: str) -> None:
    """Refuse a foreign drone that does what neither a pilot nor a controller does."""
    try:
        model.controllers.check(does)
    except PartError as error:
        pilots = ", ".join(PILOTS)
        raise SettingsError([f"drones.foreign.{name}.does: {error}; or {pilots}"]) from error
