"""A study: campaigns that differ in one thing, compared; a file in `studies/`, or the user's.

Each case of each scenario is a campaign of the same seeds, resumed like any other. The result is a
page in Markdown with a table and a plot, made from the campaigns' summaries alone.
"""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from mavlink_bridge.shared.settings import (
    Contradiction,
    SettingsError,
    StrictModel,
    load_yaml,
    validate,
)
from sitl_sim.campaigns.campaign import Campaign


class Study(StrictModel):
    """Cases to compare, each flown in every scenario."""

    title: str
    scenarios: list[str] = Field(min_length=1)
    set: list[str] = Field([], description="path.to.key=value, for all.")
    cases: dict[str, list[str]] = Field({}, description="The same, for each case.")
    grid: dict[str, list[Any]] = Field(
        {}, description="path.to.key: [values]; every combination is a case, of each of `cases`."
    )

    @model_validator(mode="after")
    def _has_cases(self) -> Self:
        if empty := [key for key, values in self.grid.items() if not values]:
            raise Contradiction((f"grid.{empty[0]}",), "needs at least one value")
        if not self.cases and not self.grid:
            raise Contradiction(("cases",), "a study has cases, a grid, or both")
        return self

    def expanded(self) -> Study:
        """Return the study with the grid's combinations as cases."""
        if not self.grid:
            return self
        short = {key: key.rpartition(".")[2] for key in self.grid}
        if len(set(short.values())) < len(short):
            short = {key: key for key in self.grid}
        cases = {}
        for name, changes in (self.cases or {"": []}).items():
            for values in itertools.product(*self.grid.values()):
                chosen = dict(zip(self.grid, values, strict=True))
                label = ", ".join(f"{short[k]}={_text(v)}" for k, v in chosen.items())
                more = [f"{k}={json.dumps(v, ensure_ascii=False)}" for k, v in chosen.items()]
                cases[f"{name}, {label}" if name else label] = [*changes, *more]
        return self.model_copy(update={"cases": cases, "grid": {}})


@dataclass(frozen=True)
class Cell:
    """One case of one scenario."""

    scenario: str
    case: str
    campaign: Campaign


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


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
    return validate(Study, load_yaml(path), str(path)).expanded()


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
