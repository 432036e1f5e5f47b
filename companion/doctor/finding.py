"""One line of a doctor's report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """green: fine. amber: flies, look at it. red: does not fly like this."""

    GREEN = "green"
    AMBER = "amber"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """What was looked at, how it is, and what to do where it is not green."""

    name: str
    level: Level
    text: str
    todo: str = ""


def rated(name: str, value: float, limits: tuple[float, float], text: str, todo: str) -> Finding:
    """Green up to the first limit, amber up to the second, red above."""
    green, amber = limits
    level = Level.GREEN if value <= green else Level.AMBER if value <= amber else Level.RED
    return Finding(name, level, text, "" if level is Level.GREEN else todo)


def either(name: str, fine: bool, text: str, todo: str, worst: Level = Level.RED) -> Finding:
    """Green where fine, else `worst`."""
    return Finding(name, Level.GREEN if fine else worst, text, "" if fine else todo)
