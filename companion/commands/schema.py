"""`companion schema`: the JSON Schema of a drone's file, for editors."""

from __future__ import annotations

import argparse
import json
from typing import Any

HELP = "print the JSON Schema of a drone's file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """It takes none."""


def run(options: argparse.Namespace) -> int:
    """Print it."""
    print(json.dumps(schema(), indent=1))
    return 0


def schema() -> dict[str, Any]:
    """The schema; every key has its description, only `fileversion` must stand in each file."""
    from companion.settings.config import CompanionConfig

    made = CompanionConfig.model_json_schema()
    airframe = {"type": "string", "description": "Name of a file in airframes/."}
    made["properties"]["airframe"] = {"anyOf": [airframe, {"$ref": "#/$defs/AirframeConfig"}]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **made,
        "title": "swarm-companion: a drone",
        "required": ["fileversion"],
    }
