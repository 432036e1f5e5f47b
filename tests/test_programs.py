"""All programs of the distribution tell its version."""

import importlib
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

_PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("program", _PROJECT["scripts"])
def test_every_program_tells_the_version(program, capsys):
    module, _, function = _PROJECT["scripts"][program].partition(":")
    with pytest.raises(SystemExit) as end:
        getattr(importlib.import_module(module), function)(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out.strip() == version("swarm-companion")
