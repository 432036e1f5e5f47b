"""Fixtures for tests of drones' files."""

import pytest

from companion.settings.config import load_config
from mavlink_bridge.shared.settings import SettingsError

HEAD = "fileversion: 2\nname: one\n"  # two lines: a mistake begins on line 3


@pytest.fixture
def folder(tmp_path):
    """A folder of drones with an airframe."""
    (tmp_path / "airframes").mkdir()
    (tmp_path / "airframes" / "quad5.yaml").write_text(
        "fileversion: 2\nairframe: {name: quad5, hover_thrust: 0.4}\n"
    )
    return tmp_path


@pytest.fixture
def check(folder):
    """Check that a file of HEAD and `text` has one problem, at `place`, that says `what`."""

    def check(text, place, what):
        file = folder / "one.yaml"
        file.write_text(HEAD + text)
        with pytest.raises(SettingsError) as caught:
            load_config(file)
        assert len(caught.value.problems) == 1, caught.value.problems
        problem = caught.value.problems[0]
        assert problem.startswith(f"{file}:{place}: ")
        assert what.replace("FILE", str(file)) in problem

    return check
