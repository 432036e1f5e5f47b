"""A finding of the doctor, and how it is rated."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """green: good. amber: can fly, needs a look. red: cannot fly like this."""

    GREEN = "green"
    AMBER = "amber"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """What was examined, its level, the result, and what to do where it is not green."""

    name: str
    level: Level
    text: str
    todo: str = ""


def rated(name: str, value: float, limits: tuple[float, float], text: str, todo: str) -> Finding:
    """Return a finding: green up to the first limit, amber up to the second, red above."""
    green, amber = limits
    level = Level.GREEN if value <= green else Level.AMBER if value <= amber else Level.RED
    return Finding(name, level, text, "" if level is Level.GREEN else todo)


def either(name: str, fine: bool, text: str, todo: str, worst: Level = Level.RED) -> Finding:
    """Return a finding: green where `fine`, else `worst`."""
    return Finding(name, Level.GREEN if fine else worst, text, "" if fine else todo)
