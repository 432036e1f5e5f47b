"""A file of missions (worlds with a start and a goal for each drone), the form of benchmarks.

JSON: `drone_radius` [m]; `missions`: by number, `cylinders` [[x, y, radius], …] and `agents`
[{"start": [x, y, z], "goal": [x, y, z]}, …], all in metres. Optional `arena`: {"max": [x, y, z]}.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import Field

from mavlink_bridge.shared.settings import SettingsError, StrictModel
from sitl_sim.worlds.world import Cylinder, Point2, Point3


class Mission(StrictModel):
    """One mission: a start and a goal for each drone, of this radius [m]."""

    cylinders: list[Cylinder]
    starts: list[Point2]
    goals: list[Point3]
    drone_radius: float = Field(gt=0)


def read_mission(path: Path, seed: int, drones: int) -> Mission:
    """Read mission number `seed` (modulo their number) of a file, for its first `drones` agents.

    Raises:
        SettingsError: the file cannot be read, holds no missions, or has too few agents.
    """
    try:
        data = json.loads(path.read_text("utf-8"))
        missions: list[dict[str, Any]] = list(data["missions"].values())
        chosen = missions[seed % len(missions)]
        agents = chosen["agents"]
        mission = Mission(
            cylinders=[Cylinder(x=x, y=y, radius=r) for x, y, r in chosen["cylinders"]],
            starts=[[float(c) for c in a["start"][:2]] for a in agents[:drones]],
            goals=[[float(c) for c in a["goal"]] for a in agents[:drones]],
            drone_radius=float(data["drone_radius"]),
        )
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
        raise SettingsError([f"world.missions: {path}: {why}"]) from error
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        why = f"no file of missions: {' '.join(str(error).split())}"
        raise SettingsError([f"world.missions: {path}: {why}"]) from error
    if len(agents) < drones:
        raise SettingsError([f"drones.count: {path} has {len(agents)} agents, not {drones}"])
    return mission
