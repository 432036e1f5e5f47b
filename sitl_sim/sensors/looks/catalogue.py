"""The names of looks, and what `catalogue.yaml` says about each."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from mavlink_bridge.shared.settings import load_yaml

PLAIN = "plain"  # the first renderer's one look


@cache
def catalogue() -> dict[str, Any]:
    """Return the sections of `catalogue.yaml`: colours, defaults, looks, unreadable."""
    with resources.as_file(resources.files("sitl_sim.sensors.looks") / "catalogue.yaml") as path:
        data: dict[str, Any] = load_yaml(path).data
    return data


def names() -> list[str]:
    """Return the valid names of `world.look`, readable ones first."""
    return [PLAIN, *catalogue()["looks"], *catalogue()["unreadable"]]


def readable() -> list[str]:
    """Return the names of the looks in which a camera can see, without plain and random."""
    return [name for name in catalogue()["looks"] if name != "random"]


def unreadable() -> list[str]:
    """Return the names of the looks in which no camera sees."""
    return list(catalogue()["unreadable"])


def check(name: str) -> str:
    """Return the name of a look.

    Raises:
        ValueError: there is no such look; the message names the valid ones.
    """
    if name not in names():
        raise ValueError(f"no look {name!r}; valid: {', '.join(names())}")
    return name
