"""`sitl-sim scenarios` lists the packaged scenarios and draws their plans."""

from sitl_sim.__main__ import main


def test_scenarios_are_listed_and_drawn(tmp_path, capsys):
    assert main(["scenarios", "--plans", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    assert "crossing" in listed
    assert "10 drones from four sides" in listed
    assert b"circle, seed 0" in (tmp_path / "circle.svg").read_bytes()


def test_a_world_of_ones_own_is_looked_at_before_it_is_flown(tmp_path, capsys):
    (tmp_path / "trees.csv").write_text("x,y,radius\n1,2,0.5\n3,4,0.5\n")
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        f"fileversion: 1\nname: mine\nworld: {{obstacles: {tmp_path / 'trees.csv'}}}\n"
        "drones: {count: 1}\nmission: {targets: [[9.0, 0.0, 2.0]]}\n"
    )
    assert main(["scenarios", str(mine), "--plans", str(tmp_path)]) == 0
    assert ": 2 trunks, 0 boxes listed or from files; generator empty" in capsys.readouterr().out
    assert b"mine, seed 0" in (tmp_path / "mine.svg").read_bytes()


def test_how_hard_a_world_is_is_told_by_its_seed_and_a_goal_without_a_way_is_named(
    tmp_path, capsys
):
    mine = tmp_path / "mine.yaml"
    walls = "boxes: [{min: [4, -90, 0], max: [5, 90, 9]}]"
    for world, told in (("generator: empty", "obstruction 0.50"), (walls, "leg 1: no way to")):
        mine.write_text(
            f"fileversion: 1\nname: mine\nworld: {{{world}}}\n"
            "drones: {count: 1}\nmission: {targets: [[9.0, 0.0, 2.0]], home: false}\n"
        )
        assert main(["scenarios", str(mine), "--difficulty"]) == 0
        assert told in capsys.readouterr().out
    found = []
    for seed in ("1", "2"):
        assert main(["scenarios", "--difficulty", "--seed", seed]) == 0
        found.append(capsys.readouterr().out.split("spaced-forest")[1].splitlines()[1])
    assert all("trunks a hectare" in line for line in found)
    assert found[0] != found[1]
