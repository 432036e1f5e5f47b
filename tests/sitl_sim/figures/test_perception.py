"""Errors planted in logs appear in the figures of perception."""

import numpy as np
import pytest

from sitl_sim.figures.perception import perception, score_frames
from tests.sitl_sim import flights


def figures(**mistakes):
    truth = flights.truth()
    logs = {n: flights.log(i, truth, **mistakes) for i, n in enumerate(flights.NAMES)}
    return perception(score_frames(flights.scenario(), flights.WORLD, truth, logs))


def test_complete_detections_have_no_errors():
    f = figures()
    assert (f["recall"], f["precision"]) == (1.0, 1.0)
    assert (f["track_recall"], f["track_precision"]) == (1.0, 1.0)
    assert f["range_error_median"] < 1e-9
    assert f["bearing_error_deg"] < 1e-6
    assert f["velocity_rmse_m_s"] < 0.01
    # Drone 1 sees two drones ahead; these see none: each other 90° off, outside the view.
    assert f["frames"] > 300


@pytest.mark.parametrize(("miss", "ghost"), [(0.2, 0.0), (0.0, 0.2), (0.1, 0.1)])
def test_misses_and_ghosts(miss, ghost):
    f = figures(miss=miss, ghost=ghost)
    assert f["recall"] == pytest.approx(1 - miss, abs=0.08)
    assert (f["precision"] < 0.97) == (ghost > 0)


@pytest.mark.parametrize(("camera", "recall"), [("dead", 0.5), ("none", 1.0)])
def test_frames_that_did_not_come_are_missed_where_the_camera_is_faulty(camera, recall):
    """A tick without a frame from a healthy camera lies between two frames."""
    truth = flights.truth()
    logs = {n: flights.log(i, truth) for i, n in enumerate(flights.NAMES)}
    for tick in logs["drone1"][1::2]:
        tick.update(frame=None, detections=[], camera=camera)
    f = perception(score_frames(flights.scenario(), flights.WORLD, truth, logs))
    assert f["recall"] == pytest.approx(recall, abs=0.02)
    assert f["track_recall"] == 1.0


def test_errors_of_range_bearing_and_velocity():
    f = figures(stretch=1.07, turn=np.radians(1.0), slow=0.4)
    assert f["range_error_median"] == pytest.approx(0.07, abs=1e-6)
    assert f["bearing_error_deg"] == pytest.approx(1.0, abs=0.4)
    assert f["velocity_rmse_m_s"] == pytest.approx(0.4, abs=0.02)


def test_a_drone_behind_a_wall_is_not_in_view():
    truth = flights.truth()
    logs = {n: flights.log(i, truth) for i, n in enumerate(flights.NAMES)}
    for tick in logs["drone1"]:
        tick["detections"] = []
    wall = {"min": [1.0, -9.0, 0.0], "max": [1.2, 9.0, 9.0]}
    open_field = perception(score_frames(flights.scenario(), flights.WORLD, truth, logs))
    walled = perception(
        score_frames(flights.scenario(), flights.WORLD | {"boxes": [wall]}, truth, logs)
    )
    assert open_field["recall"] == 0.0
    assert walled["frames"] == open_field["frames"]
    hidden = [
        s.in_view
        for s in score_frames(flights.scenario(), flights.WORLD | {"boxes": [wall]}, truth, logs)[
            "drone1"
        ]
    ]
    assert hidden[10] == 0
    assert hidden[-1] == 2


def test_a_drone_behind_another_drone_is_not_in_view():
    truth = flights.truth(gap=0.0)
    truth["position"][:, 2] += [3.0, 0.0, 0.0]  # drone 3 behind drone 2, seen from drone 1
    logs = {n: flights.log(i, truth) for i, n in enumerate(flights.NAMES)}
    seen_by = score_frames(flights.scenario(), flights.WORLD, truth, logs)["drone1"]
    assert {s.in_view for s in seen_by if s.time > 3.0} == {1}
    truth["position"][:, 2] += [0.0, 1.0, 0.0]
    seen_by = score_frames(flights.scenario(), flights.WORLD, truth, logs)["drone1"]
    assert {s.in_view for s in seen_by if s.time > 3.0} == {2}


def test_without_frames_there_are_no_figures():
    f = perception({"drone1": []})
    assert f["recall"] is None
    assert f["velocity_rmse_m_s"] is None
