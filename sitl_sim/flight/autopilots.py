"""The autopilots of a flight: emulated, or real ones on the simulator's physics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.external.fleet import RealFleet, Wire
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.flight.own_binary import boot_parameters, own_binary, own_path
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.companion_config import companion_port
from sitl_sim.scenarios.conditions import drawn
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.vehicles.air import AirModel
from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.airframes import Deviation
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.firmware.late_samples import TelemetryLag
from sitl_sim.vehicles.foreign import ForeignFleet, Hover, Pilot, Pursue, Straight
from sitl_sim.vehicles.grades import GRADES
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame
from sitl_sim.worlds.ground import Ground

_LAG_DRAW = 6  # of `conditions.drawn`


def switch_on(
    scenario: Scenario,
    vehicles: Vehicles,
    folder: Path,
    start: Vector,
    boot_ms: Sequence[int],
    ground: Ground,
) -> Autopilots | RealFleet | LockstepFleet:
    """Return the running autopilots of a scenario's vehicles; start: (n,3) m, their own origins.

    Raises:
        ExternalError, NamespaceError: a real autopilot cannot be run; the message says why.
    """
    names, yaws = scenarios.drone_names(scenario), placement.frame_yaws(scenario)
    systems = list(range(1, len(names) + 1))
    folders = [folder / "drones" / name for name in names]
    boot = np.array(boot_ms) / 1e3
    if scenario.drones.own_time:
        wire = scenario.wire
        wires = [Wire(wire.host, companion_port(wire, k), wire.gcs_port) for k in systems]
        return RealFleet(
            vehicles,
            systems,
            folders,
            wires,
            origin=start,
            yaw_offset=yaws,
            seed=scenario.seed,
            binary=own_path(scenario.drones) if scenario.drones.binary else None,
        )
    assumed = [scenario.drones.airframe(i) for i in range(len(names))]
    if scenario.drones.real:
        frames = [
            LocalFrame(o.copy(), float(y), GeoReference()) for o, y in zip(start, yaws, strict=True)
        ]
        clock = [float(b) for b in boot]
        program = own_binary(scenario, folders, frames, assumed, clock)
        return LockstepFleet(vehicles, program, clock)
    return Autopilots(
        vehicles,
        systems,
        scenario.drones.autopilot,
        origin=start,
        yaw_offset=yaws,
        boot_offset=boot,
        seed=scenario.seed,
        parameters=boot_parameters(scenario),
        grade=GRADES[scenario.drones.state],
        telemetry_lag=_telemetry_lag(scenario),
        rangefinder=scenario.drones.ranges,
        ground=ground,
        assumed=assumed,
        rate_gains=[d.gains(RateGains()) for d in deviations_of(scenario)],
        air=AirModel(scenario.wind.turbulence, scenario.air.downwash, scenario.air.ground_effect),
    )


def foreign_fleet(
    scenario: Scenario, autopilots: Autopilots, start: Vector, trunks: Vector
) -> ForeignFleet:
    """Return what flies the foreign drones without companions.

    start: (n,3) m, world. trunks: (k,3) x, y, radius, m.
    """
    return ForeignFleet(autopilots, _pilots(scenario, start, trunks))


def _pilots(scenario: Scenario, start: Vector, trunks: Vector) -> Iterator[Pilot]:
    names = scenarios.drone_names(scenario)
    foreign, targets = scenario.drones.foreign, placement.targets(scenario, start)
    ours = [i for i, name in enumerate(names) if name not in foreign]
    for i, name in enumerate(names):
        config = foreign.get(name)
        if config is None or not config.piloted:
            continue
        place = start[i] + np.array([0.0, 0.0, scenario.mission.altitude])
        if config.does == "straight":
            yield Straight(i, place, targets[name], config.fastest, trunks)
        elif config.does == "pursue":
            yield Pursue(i, place, ours, start[:, 2], config.fastest, config.begins)
        else:
            yield Hover(i, place)


def deviations_of(scenario: Scenario) -> list[Deviation]:
    """Return how each vehicle differs from its airframe."""
    drones = scenario.drones
    return drones.actual.deviations(drones.count, scenario.seed)


def true_airframes(scenario: Scenario) -> list[Airframe]:
    """Return the true airframe of each vehicle."""
    deviations = enumerate(deviations_of(scenario))
    return [d.airframe(scenario.drones.airframe(i)) for i, d in deviations]


def _telemetry_lag(scenario: Scenario) -> TelemetryLag | None:
    timing = scenario.timing
    lags = drawn(timing.telemetry_lag, scenario.drones.count, scenario.seed, _LAG_DRAW)
    if not lags.any() and not timing.telemetry_jitter:
        return None
    return TelemetryLag(lags.tolist(), timing.telemetry_jitter, timing.telemetry_stamp)
