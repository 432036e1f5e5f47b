"""`companion schema`: the JSON Schema of a drone's file, for editors."""

from __future__ import annotations

import argparse
import json
from typing import Any

HELP = "print the JSON Schema of a drone's file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command takes no arguments."""


def run(options: argparse.Namespace) -> int:
    """Print the schema."""
    print(json.dumps(schema(), indent=1))
    return 0


def schema() -> dict[str, Any]:
    """Return the schema; only `fileversion` is required in each file."""
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
