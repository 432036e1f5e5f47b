"""The tutorials of the drones, command by command, as far as a desk allows."""

import pytest

from mavlink_bridge.betaflight.config import load_bridge_config
from tests.docs.tutorial import ROOT, follow

pytestmark = pytest.mark.timeout(1800)  # flights, on a loaded machine
TUTORIALS = ROOT / "docs" / "tutorials"


def test_the_hobbyists_files_are_accepted(tmp_path):
    follow(TUTORIALS / "hobbyist.md", tmp_path)
    bridge = load_bridge_config(tmp_path / "my-drone" / "bridges" / "drone1.yaml")
    assert bridge.throttle.hover == 0.36


def test_the_engineer_brings_three_boards_up_as_far_as_a_desk_allows(tmp_path):
    said = follow(TUTORIALS / "engineer.md", tmp_path)
    assert "did you mean 'altitude_max'" in said
    for name in ("drone1", "drone2", "drone3"):  # the steps of a deployment, each with its unit
        assert f"companion@{name}" in said
    assert "mavlink-bridge@drone3" in said
    assert not list(tmp_path.glob("image*"))  # --dry-run changes nothing
