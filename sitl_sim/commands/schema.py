"""`sitl-sim schema`: the JSON Schema of a scenario or a study, for editors."""

from __future__ import annotations

import argparse
import json
from typing import Any

from sitl_sim.commands.exit_status import EXIT_OK

HELP = "print the JSON Schema of a scenario's file, or of a study's"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --study."""
    parser.add_argument("--study", action="store_true", help="of a study, not of a scenario")


def run(options: argparse.Namespace) -> int:
    """Print the schema."""
    print(json.dumps(schema(options.study), indent=1))
    return EXIT_OK


def schema(study: bool = False) -> dict[str, Any]:
    """Return the schema of a scenario, or of a study."""
    from sitl_sim.campaigns.study import Study
    from sitl_sim.scenarios.scenario import Scenario

    made = Study.model_json_schema() if study else Scenario.model_json_schema(by_alias=True)
    kind = "study" if study else "scenario"
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **made,
        "title": f"swarm-companion: a {kind}",
    }
