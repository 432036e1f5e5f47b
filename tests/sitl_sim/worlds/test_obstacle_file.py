"""Trunks from CSV and GeoJSON files; every mistake is told with its file and row."""

import json

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.worlds.obstacle_file import read_obstacles


def feature(longitude, latitude, **properties):
    point = {"type": "Point", "coordinates": [longitude, latitude]}
    return {"type": "Feature", "geometry": point, "properties": properties}


def geojson(folder, *features, **more):
    file = folder / "trees.geojson"
    data = {"type": "FeatureCollection", "features": features, **more}
    file.write_text(json.dumps(data))
    return file


def test_a_row_is_a_trunk(tmp_path):
    file = tmp_path / "trees.csv"
    file.write_bytes(
        b"\xef\xbb\xbfx, y, radius, height, kind\r\n1.5,-2,0.3,6,oak\r\n4,5,0.25,,ash\r\n"
    )
    one, two = read_obstacles(file)
    assert (one.x, one.y, one.radius, one.height) == (1.5, -2.0, 0.3, 6.0)
    assert (two.x, two.y, two.radius, two.height) == (4.0, 5.0, 0.25, 8.0)
    loaded = scenarios.load("forest", [f"world.obstacles={file}", "world.generator=empty"])
    assert len(loaded.world.cylinders) == 2
    assert loaded.world.obstacles is None  # a run folder needs the file no longer


def test_degrees_become_metres_about_their_mean(tmp_path):
    # A minute of latitude is a nautical mile, 1852 m; east shrinks by the cosine of the latitude.
    file = geojson(tmp_path, feature(8, 60, radius=0.5), feature(8 + 2 / 60, 60 + 1 / 60, radius=1))
    one, two = read_obstacles(file)
    assert two.y - one.y == pytest.approx(1852, rel=0.005)
    assert two.x - one.x == pytest.approx(2 * 1855 * 0.5, rel=0.005)
    assert (one.x + two.x, one.y + two.y) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_the_origin_can_be_given(tmp_path):
    (one,) = read_obstacles(geojson(tmp_path, feature(8.0, 60.0, radius=0.5), origin=[8.0, 60.0]))
    assert (one.x, one.y) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y\n1,2\n", r"trees.csv:1: needs the columns x, y, radius, has x, y"),
        ("x,y,radius\n1,2,0.5\n1,2,-1\n", r"trees.csv:3: radius: must be > 0, got -1.0"),
        ("x,y,radius\n1,two,0.5\n", r"trees.csv:2: could not convert string to float: 'two'"),
        ("x,y,radius\n1,,0.5\n", r"trees.csv:2: y: is missing"),
        ("x,y,radius\nnan,2,0.5\n", r"trees.csv:2: x: must be a finite number"),
        ("x,y,radius\n", r"trees.csv: holds no obstacle"),
    ],
)
def test_a_mistake_names_its_row(tmp_path, text, words):
    file = tmp_path / "trees.csv"
    file.write_text(text)
    with pytest.raises(SettingsError, match=words):
        read_obstacles(file)


def test_what_is_no_survey_is_told(tmp_path):
    line = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": []}}
    with pytest.raises(SettingsError, match=r"features.0: must be a Point, got LineString"):
        read_obstacles(geojson(tmp_path, line))
    with pytest.raises(SettingsError, match="must be longitude, latitude"):
        read_obstacles(geojson(tmp_path, feature(8, 600, radius=1)))
    with pytest.raises(SettingsError, match=r"features.0: radius: is missing"):
        read_obstacles(geojson(tmp_path, feature(8, 60)))
    with pytest.raises(SettingsError, match=r"world.obstacles: .*cannot be read: No such file"):
        read_obstacles(tmp_path / "none.csv")
    (tmp_path / "trees.txt").touch()
    with pytest.raises(SettingsError, match=r"must end in .csv, .geojson, .pcd or .ply"):
        read_obstacles(tmp_path / "trees.txt")
