"""`sitl-sim scenarios` lists the packaged scenarios and draws their plans."""

from sitl_sim.__main__ import main


def test_scenarios_are_listed_and_drawn(tmp_path, capsys):
    assert main(["scenarios", "--plans", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    assert "crossing" in listed
    assert "10 drones from four sides" in listed
    assert b"circle, seed 0" in (tmp_path / "circle.svg").read_bytes()
