"""The command line: every subcommand is a module, and mistakes are one line."""

import importlib
from importlib.metadata import version

import pytest

from sitl_sim.__main__ import COMMANDS, main


def test_the_version_is_that_of_the_distribution(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out.strip() == version("swarm-companion")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    help_line = importlib.import_module(f"sitl_sim.commands.{name}").HELP
    assert help_line.split()[0] in capsys.readouterr().out
