"""One drone's configuration: default ← airframe ← drone, validated as a whole.

`default.yaml` beside a drone's file (or none) lies below `airframes/NAME.yaml`, which lies
below the drone's own file. Angles that a person writes are in degrees and say so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import model_validator

from companion.control.baselines import CONTROLLERS, is_rule
from companion.guidance.guidance import GuidanceSettings
from companion.settings.consistency import contradictions
from companion.settings.sections import CompanionSections
from mavlink_bridge.shared.parts import PartKind
from mavlink_bridge.shared.settings import (
    Document,
    assignments,
    load_yaml,
    merge,
    validate,
)

FILEVERSION = 2
_NEIGHBOURS = 12  # flocking rules sum over all neighbours in view, not the most critical
DEFAULT, AIRFRAMES, BRIDGES = "default.yaml", "airframes", "bridges"


class CompanionConfig(CompanionSections):
    """The whole configuration of one drone."""

    controllers: ClassVar[PartKind] = CONTROLLERS
    """What `controller` may be."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for contradiction in contradictions(self):
            raise contradiction
        return self

    def for_controller(self) -> CompanionConfig:
        """Return the configuration as its `controller` needs it.

        single-horizon: cohesion and distances over all of N, the conventional NMPC. The velocity
        rules get every neighbour in view and the goal as it is, without right of way: they have
        their own. A user's planner gets what the NMPC gets.
        """
        if self.controller == "nmpc":
            return self
        if self.controller == "single-horizon":
            whole = {"M": self.nmpc.N, "M_constraint": self.nmpc.N}
            return self.model_copy(update={"nmpc": self.nmpc.model_copy(update=whole)})
        if not is_rule(self.controller):
            return self
        changes = {
            "nmpc": {"neighbours": _NEIGHBOURS},
            "threat": {"critical": _NEIGHBOURS},
            "right_of_way": {"keep_right": 0.0},
        }
        return self.model_copy(
            update={k: getattr(self, k).model_copy(update=v) for k, v in changes.items()}
        )

    @property
    def slow(self) -> float:
        """The least speed [m/s] to which headway slows a drone down."""
        return self.speed_limits.headway_least * self.nmpc.speed

    def guidance(self) -> GuidanceSettings:
        """Return the settings of guidance, which come from several sections."""
        return GuidanceSettings(
            mission=self.mission,
            gaze=self.gaze,
            threat=self.threat,
            right_of_way=self.right_of_way,
            speed_limits=self.speed_limits,
            surfaces=self.surfaces,
            fence=self.fence,
            cruise=self.nmpc.speed,
            v_max=self.nmpc.v_max,
            blind_speed=self.guard.blind_speed,
            d_ref=self.nmpc.d_ref,
            d_agent=self.nmpc.d_agent_safety,
            d_obstacle=self.nmpc.d_obstacle_safety,
        )


def load_config(path: Path, overrides: list[str] | None = None) -> CompanionConfig:
    """Return the configuration of a drone's file and its layers.

    overrides: path.to.key=value, on top of the file.

    Raises:
        SettingsError: every mistake, as `file:line:column: key: what`.
    """
    return validate(CompanionConfig, resolve(path, overrides), str(path))


def resolve(path: Path, overrides: list[str] | None = None) -> Document:
    """Return the layers of a drone's file as one document, with the place of each value.

    Raises:
        SettingsError: a file that cannot be read at all; other mistakes wait in the document.
    """
    drone = _layer(path)
    layers = [] if is_layer(path) else [*_default(path), *_airframe(path, drone)]
    return merge([*layers, drone, assignments(overrides or [])])


def is_layer(path: Path) -> bool:
    """Return whether a file is a layer below drones: default.yaml, airframes/*.yaml."""
    return path.name == DEFAULT or path.parent.name == AIRFRAMES


def is_bridge(path: Path) -> bool:
    """Return whether a file configures a `mavlink-bridge`: it lies in bridges/."""
    return path.parent.name == BRIDGES


def bridge_of(path: Path) -> Path:
    """Return the file of a drone's bridge: bridges/, under the drone file's name."""
    return path.parent / BRIDGES / path.name


def layers_of(path: Path) -> list[Path]:
    """Return the existing files that lie below a drone's file, lowest first."""
    name = _airframe_name(load_yaml(path))
    files = [path.parent / DEFAULT, path.parent / AIRFRAMES / f"{name}.yaml"]
    return [] if is_layer(path) else [f for f in files if f.exists()]


def _layer(path: Path) -> Document:
    """Return one file, which must name the version of this format."""
    document = load_yaml(path)
    if "fileversion" not in document.data:
        document.problems.append(f"{path}:1:1: fileversion: is missing; valid: {FILEVERSION}")
    elif (found := document.data["fileversion"]) != FILEVERSION:
        place = document.places[("fileversion",)]
        document.problems.append(f"{place}: fileversion: must be {FILEVERSION}, got {found!r}")
        document.data["fileversion"] = FILEVERSION  # one message is enough
    airframe = document.data.get("airframe")
    if isinstance(airframe, str):  # `airframe: quad5` is short for `airframe: {name: quad5}`
        document.data["airframe"] = {"name": airframe}
        document.places["airframe", "name"] = document.places[("airframe",)]
    for section, key in (("camera", "calibration"), ("sensing", "model")):
        part = document.data.get(section)
        if isinstance(part, dict) and isinstance(part.get(key), str):
            part[key] = str(path.parent / part[key])
    return document


def _default(path: Path) -> list[Document]:
    default = path.parent / DEFAULT
    return [_layer(default)] if default.exists() else []


def _airframe(path: Path, drone: Document) -> list[Document]:
    """Return the layer of the airframe that the drone names, if any."""
    name = _airframe_name(drone)
    if name is None:
        return []
    folder = path.parent / AIRFRAMES
    file = folder / f"{name}.yaml"
    if file.exists():
        return [_layer(file)]
    known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml"))) or f"none in {folder}"
    place = drone.places["airframe", "name"]
    drone.problems.append(f"{place}: airframe.name: unknown airframe {name!r}; valid: {known}")
    return []


def _airframe_name(drone: Document) -> str | None:
    airframe: Any = drone.data.get("airframe")
    name = airframe.get("name") if isinstance(airframe, dict) else airframe
    return name if isinstance(name, str) else None
