"""The chances by which neighbours and trunks are known to be there."""

import pytest

from companion.settings.config import load_config
from mavlink_bridge.shared.settings import SettingsError


@pytest.mark.parametrize("section", ["tracker", "obstacles"])
@pytest.mark.parametrize("ghosts", [0.5, 0.6])
def test_looks_must_be_likelier_where_something_is(tmp_path, section, ghosts):
    file = tmp_path / "drone.yaml"
    file.write_text(f"fileversion: 2\n{section}: {{detected: 0.5, ghosts: {ghosts}}}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    (problem,) = caught.value.problems
    assert problem.startswith(f"{file}:2:")
    assert f"ghosts, {ghosts:g}, must be below detected, 0.5" in problem
