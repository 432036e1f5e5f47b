"""A study: campaigns that differ in one thing, compared; a file in `studies/`, or the user's.

Each case of each scenario is a campaign of the same seeds, resumed like any other. The result is a
page in Markdown with a table and a plot, made from the campaigns' summaries alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from pydantic import Field

from mavlink_bridge.shared.settings import SettingsError, StrictModel, load_yaml, validate
from sitl_sim.campaigns.campaign import Campaign


class Study(StrictModel):
    """Cases to compare, each flown in every scenario."""

    title: str
    scenarios: list[str] = Field(min_length=1)
    set: list[str] = Field([], description="path.to.key=value, for all.")
    cases: dict[str, list[str]] = Field(min_length=1, description="The same, for each case.")


@dataclass(frozen=True)
class Cell:
    """One case of one scenario."""

    scenario: str
    case: str
    campaign: Campaign


def names() -> list[str]:
    """Return the names of the packaged studies."""
    folder = resources.files("sitl_sim") / "campaigns" / "studies"
    return sorted(
        f.name.removesuffix(".yaml") for f in folder.iterdir() if f.name.endswith(".yaml")
    )


def load(name: str) -> Study:
    """Read a study by name or YAML file.

    Raises:
        SettingsError: with every mistake and its place, or the valid names.
    """
    if name in names():
        path = Path(str(resources.files("sitl_sim") / "campaigns" / "studies" / f"{name}.yaml"))
    elif name.endswith((".yaml", ".yml")):
        path = Path(name)
    else:
        known = ", ".join(names())
        raise SettingsError([f"no study {name!r}; valid: {known}, or a .yaml file"])
    return validate(Study, load_yaml(path), str(path))


def cells(study: Study, folder: Path, runs: int, first_seed: int, in_process: bool) -> list[Cell]:
    """Return every case of every scenario, each with a campaign folder of its own.

    Raises:
        SettingsError: the settings of a case are wrong.
    """
    found = []
    for scenario in study.scenarios:
        for case, changes in study.cases.items():
            place = folder / Path(scenario).stem / case.replace(" ", "-").replace("/", "-")
            overrides = [*study.set, *changes]
            campaign = Campaign(scenario, overrides, runs, first_seed, place, in_process)
            found.append(Cell(scenario, case, campaign))
    return found
