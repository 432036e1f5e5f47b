"""A scenario as data: world, drones, mission, sensing, timing; from YAML, with overrides."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mavlink_bridge.shared.settings import (
    Contradiction,
    Document,
    SettingsError,
    StrictModel,
    assignments,
    load_yaml,
    merge,
    validate,
)
from sitl_sim.faults import catalogue as fault
from sitl_sim.scenarios.airframes import ActualConfig, AirframeConfig, AirframeName
from sitl_sim.scenarios.conditions import AirConfig, TimingConfig, WindConfig
from sitl_sim.scenarios.foreign import ForeignConfig, check_names
from sitl_sim.scenarios.sensing import SensingConfig
from sitl_sim.sensors.looks.catalogue import PLAIN, check
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.grades import StateGrade
from sitl_sim.worlds.generators import build
from sitl_sim.worlds.ground import Ground
from sitl_sim.worlds.mission_file import read_mission
from sitl_sim.worlds.obstacle_file import with_file
from sitl_sim.worlds.world import Point2, Point3, WorldConfig

QUANTUM_MS = 2  # smallest step of the simulated time
TICK_MS = 100  # between frames of a camera
REAL = ("betaflight",)  # autopilots that fly as themselves, without a binary of the user's


class DronesConfig(StrictModel):
    """The drones and their starts."""

    count: int = Field(9, ge=1, le=200)
    formation: Literal["grid", "circle"] = "grid"
    spacing: float = Field(1.5, gt=0.5, description="Between neighbours in the formation [m].")
    centre: list[float] = Field([0.0, 0.0], min_length=2, max_length=2)
    ring: float = Field(10.0, gt=0, description="circle: its radius [m].")
    heading_deg: float | Literal["target"] = Field(
        90.0, description="ENU yaw at the start; target: each faces its own first target."
    )
    starts: list[Point2] = Field([], description="[x, y] each, instead of a formation.")
    jitter: float = Field(0.1, ge=0, description="Each start is moved up to this [m].")
    shift: float = Field(0.0, ge=0, description="All starts together, across their heading [m].")
    radius: float = Field(
        0.2, gt=0, description="Of the sphere around a drone [m], where airframes says no other."
    )
    airframes: list[AirframeConfig | AirframeName] = Field(
        [],
        description="Airframes of the drones in turn; none: quad5. Autopilots and companions "
        "know them.",
    )
    actual: ActualConfig = Field(
        ActualConfig(),
        description="Factors by which the vehicles differ from what they are taken for.",
    )
    look: Literal["ball", "bare", "mixed"] = Field(
        "ball",
        description="ball: dark, with a magenta ball; bare: one kind of body without it, drawn by "
        "the seed; mixed: a kind for each drone.",
    )
    autopilot: Literal["px4", "ardupilot", "betaflight"] = Field(
        "px4",
        description="px4, ardupilot: emulated; betaflight: the real SITL, in real time.",
    )
    binary: str = Field(
        "",
        description="Your own SITL binary, which flies instead of the one named above.",
    )
    foreign: dict[str, ForeignConfig] = Field(
        {}, description="Drones that are not ours, by name: they give way to nobody."
    )
    state: StateGrade = Field(
        "mocap",
        description="What the state estimates come from, and so how wrong they are.",
    )
    rangefinder: bool | None = Field(
        None, description="A rangefinder that looks down; null: unless state is mocap."
    )
    frame_yaw_deg: float | Literal["random"] = Field(
        0.0, description="Yaw of each vehicle's own frame in the world: no frame is shared."
    )
    parameters: dict[str, float] = Field({}, description="Autopilot parameters at boot.")
    signing: bool = Field(
        False,
        description="MAVLink 2 signing: the autopilots sign, and refuse what is not signed with "
        "the flight's key; companions get the key.",
    )

    @model_validator(mode="after")
    def _knows_its_parameters(self) -> Self:
        if self.binary or not self.parameters:  # a user's binary has further parameters
            return self
        from sitl_sim.vehicles.firmware.flavours import (
            FLAVOURS,  # slow to import, seldom needed here
        )
        from sitl_sim.vehicles.firmware.parameters import unfit

        for name, value in self.parameters.items():
            if why := unfit(FLAVOURS[self.autopilot], name, value):
                raise Contradiction((f"parameters.{name}",), why)
        return self

    def airframe(self, i: int) -> Airframe:
        """Return the airframe that drone i is taken for."""
        if not self.airframes:
            return replace(Airframe(), radius=self.radius)
        chosen = self.airframes[i % len(self.airframes)]
        return (AirframeConfig(name=chosen) if isinstance(chosen, str) else chosen).airframe()

    @property
    def ranges(self) -> bool:
        """Whether the drones have rangefinders."""
        return self.state != "mocap" if self.rangefinder is None else self.rangefinder

    @property
    def real(self) -> bool:
        """Whether real autopilots fly, not emulated ones."""
        return self.autopilot in REAL or bool(self.binary)

    @property
    def own_time(self) -> bool:
        """Whether the autopilots keep their own time, so that the world cannot wait for them."""
        return self.autopilot == "betaflight"


class MissionConfig(StrictModel):
    """Targets, in the world frame."""

    targets: list[Point3] = Field([], description="[x, y, z] each, for all drones, in order.")
    targets_of: dict[str, list[Point3]] = Field({}, description="Instead, by drone name.")
    spread: bool = Field(
        False,
        description="The last target is the formation's: each drone flies to its place in it.",
    )
    exchange: bool = Field(
        False, description="Last: the place opposite the start, round drones.centre."
    )
    home: bool = Field(True, description="The last target is the drone's own start.")
    levels: list[float] = Field(
        [0.0],
        min_length=1,
        description="m above the targets: the drones are distributed over these heights at random.",
    )
    tolerance: float = Field(3.0, gt=0, description="A target is reached within this [m].")
    altitude: float = Field(2.0, gt=0.5, description="Of take-off and home [m].")
    time_limit: float = Field(180.0, gt=0, description="s.")


class WireConfig(StrictModel):
    """Ports: vehicle i talks to its companion on companion_port + i."""

    host: str = "127.0.0.1"
    companion_port: int = Field(14540, ge=1024, le=65000)
    gcs_port: int = Field(14550, ge=1024, le=65000)
    frame_port: int = Field(15540, ge=1024, le=65000)


class Scenario(StrictModel):
    """One flight, completely described."""

    fileversion: Literal[1] = 1
    name: str = Field("scenario", pattern=r"^[^./][^/]*$", max_length=100)
    description: str = ""
    seed: int = Field(0, ge=0)
    world: WorldConfig = WorldConfig()
    drones: DronesConfig = DronesConfig()
    mission: MissionConfig = MissionConfig()
    sensing: SensingConfig = SensingConfig()
    timing: TimingConfig = TimingConfig()
    wire: WireConfig = WireConfig()
    wind: WindConfig = WindConfig()
    air: AirConfig = AirConfig()
    faults: list[fault.FaultConfig] = Field([], description="Faults of the flight: docs/faults.md.")
    companion: dict[str, Any] = Field({}, description="Overrides of every companion's config.")
    emulated: dict[str, Any] = Field(
        {},
        description="Keys that lie beneath the others where the autopilots are emulated: what real "
        "ones cannot have.",
    )

    @model_validator(mode="after")
    def _needs_emulated_autopilots(self) -> Self:
        asked = {
            "drones.state": self.drones.state != "mocap",
            "drones.airframes": bool(self.drones.airframes),
            "drones.actual": self.drones.actual != ActualConfig(),
            "drones.signing": self.drones.signing,
            "drones.foreign": bool(self.drones.foreign),
            "wind.turbulence": self.wind.turbulence != "none",
            "air.downwash": self.air.downwash,
            "air.ground_effect": self.air.ground_effect,
            "world.ground": self.world.ground != "flat",
            "timing.telemetry_lag": bool(np.any(self.timing.telemetry_lag)),
        }
        if self.drones.real and (wrong := [key for key, there in asked.items() if there]):
            why = "needs emulated autopilots (drones.autopilot: px4 or ardupilot, no binary)"
            raise Contradiction(tuple(wrong[:1]), why)
        return self

    @model_validator(mode="after")
    def _looks_known(self) -> Self:
        try:
            check(self.world.look)
        except ValueError as error:
            raise Contradiction(("world.look",), str(error)) from error
        if self.world.look == PLAIN and self.drones.look != "ball":
            raise Contradiction(
                ("drones.look",), "world.look plain has drones with balls only: --balls"
            )
        grown = self.world.lean_deg or self.world.branches or self.world.bushes
        if self.world.look == PLAIN and grown:
            raise Contradiction(("world.look",), "plain shows upright trunks only")
        pictured = self.sensing.neighbours == "camera" or self.sensing.obstacles != "map"
        ground = self.world.ground
        if self.world.look == PLAIN and ground in ("uneven", "steps") and pictured:
            raise Contradiction(("world.look",), f"plain shows no hills; {ground}: clearing, …")
        walls = self.world.boxes or self.world.generator == "tunnel"
        if ground in ("slope", "steps") and walls:
            raise Contradiction(("world.ground",), f"{ground}: walls stand on level ground")
        if self.sensing.obstacles == "map" and grown:
            raise Contradiction(("sensing.obstacles",), "map tells of upright trunks only")
        return self


def names() -> list[str]:
    """Return the names of the packaged scenarios."""
    folder = resources.files("sitl_sim") / "scenarios"
    return sorted(
        f.name.removesuffix(".yaml") for f in folder.iterdir() if f.name.endswith(".yaml")
    )


def description(name: str) -> str:
    """Return the description of a packaged scenario, one line."""
    path = Path(str(resources.files("sitl_sim") / "scenarios" / f"{name}.yaml"))
    return str(load_yaml(path).data.get("description", ""))


def load(scenario: str, overrides: list[str]) -> Scenario:
    """Read a scenario by name or YAML file, with path.to.key=value overrides, ready to fly.

    Raises:
        SettingsError: with every mistake and its place, or the valid names.
    """
    loaded = with_obstacles(with_mission(read(scenario, overrides)))
    names_ = drone_names(loaded)
    if unknown := [n for n in loaded.mission.targets_of if n not in names_]:
        raise SettingsError(
            [f"mission.targets_of: no drone {unknown[0]!r}; valid: {', '.join(names_)}"]
        )
    check_names(loaded.drones.foreign, names_)
    return loaded


def read(scenario: str, overrides: list[str]) -> Scenario:
    """Read a scenario as it is written, without a lookup of its mission in `world.missions`.

    Raises:
        SettingsError: as `load`.
    """
    if scenario in names():
        path = Path(str(resources.files("sitl_sim") / "scenarios" / f"{scenario}.yaml"))
    elif scenario.endswith((".yaml", ".yml")):
        path = Path(scenario)
    else:
        known = ", ".join(names())
        raise SettingsError([f"no scenario {scenario!r}; valid: {known}, or a .yaml file"])
    document = _with_emulated(merge([load_yaml(path), assignments(overrides)]))
    return validate(Scenario, document, str(path))


def _with_emulated(document: Document) -> Document:
    """Return the document with `emulated` beneath it, or without, where real autopilots fly."""
    beneath, drones = document.data.get("emulated"), document.data.get("drones", {})
    if not isinstance(beneath, dict) or not isinstance(drones, dict):
        return document  # nothing, or a mistake that is named in the validation
    data = {key: value for key, value in document.data.items() if key != "emulated"}
    places = {key: place for key, place in document.places.items() if key[:1] != ("emulated",)}
    rest = Document(data, places, document.problems)
    if drones.get("autopilot") in REAL or drones.get("binary"):
        return rest
    moved = {
        k[1:]: place for k, place in document.places.items() if k[:1] == ("emulated",) and k[1:]
    }
    return merge([Document(beneath, moved), rest])


def with_mission(scenario: Scenario) -> Scenario:
    """Return the scenario with world, starts and targets of the seed's mission filled in.

    Raises:
        SettingsError: `world.missions` is missing or holds no missions; the message names it.
    """
    if scenario.world.generator != "missions":
        return scenario
    if scenario.world.missions is None:
        raise SettingsError(
            [
                f"world.missions: {scenario.name} needs the file that holds its "
                "missions: --set world.missions=FILE"
            ]
        )
    mission = read_mission(Path(scenario.world.missions), scenario.seed, scenario.drones.count)
    names_ = [f"drone{i + 1}" for i in range(scenario.drones.count)]
    return scenario.model_copy(
        update={
            "world": scenario.world.model_copy(
                update={"generator": "empty", "missions": None, "cylinders": mission.cylinders}
            ),
            "drones": scenario.drones.model_copy(
                update={"starts": mission.starts, "radius": mission.drone_radius}
            ),
            "mission": scenario.mission.model_copy(
                update={"targets_of": {n: [g] for n, g in zip(names_, mission.goals, strict=True)}}
            ),
        }
    )


def with_obstacles(scenario: Scenario) -> Scenario:
    """Return the scenario with the obstacles of `world.obstacles` filled in.

    Raises:
        SettingsError: the file cannot be read, or holds mistakes; the message names each.
    """
    return scenario.model_copy(update={"world": with_file(scenario.world)})


def fault_schedule(scenario: Scenario) -> fault.Schedule:
    """Return the scenario's faults by drone.

    Raises:
        SettingsError: this scenario cannot have a fault, or its drone does not exist.
    """
    s = scenario.sensing
    fault.check(
        scenario.faults,
        emulated=not scenario.drones.real,
        line=not scenario.drones.own_time,
        pixels="camera" in (s.neighbours, s.obstacles),
        reports=s.neighbours == "truth",
    )
    return fault.Schedule(scenario.faults, drone_names(scenario), scenario.seed)


def drone_names(scenario: Scenario) -> list[str]:
    """Return drone1 … droneN."""
    return [f"drone{i + 1}" for i in range(scenario.drones.count)]


def foreign_names(scenario: Scenario) -> list[str]:
    """Return the names of the drones that are not ours, by number."""
    return [name for name in drone_names(scenario) if name in scenario.drones.foreign]


def companion_names(scenario: Scenario) -> list[str]:
    """Return the names of the drones that have a companion, by number."""
    foreign = scenario.drones.foreign
    return [n for n in drone_names(scenario) if n not in foreign or not foreign[n].piloted]


def controllers(scenario: Scenario) -> set[str]:
    """Return the controllers of all companions, where the scenario names them."""
    foreign = scenario.drones.foreign
    named = {foreign[n].does for n in companion_names(scenario) if n in foreign}
    return named | {str(c) for c in [scenario.companion.get("controller")] if c is not None}


def ground_of(scenario: Scenario) -> Ground:
    """Return the ground of the scenario's world."""
    if scenario.world.ground == "flat":
        return Ground({})
    return _ground(scenario.world.model_dump_json(), scenario.seed)


@lru_cache(maxsize=4)
def _ground(world: str, seed: int) -> Ground:
    return Ground(build(WorldConfig.model_validate_json(world), seed))
