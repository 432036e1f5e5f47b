"""The detectors' figures on rendered frames of a seed used for nothing else, with their goals."""

import pytest

from companion.bench.labels import load
from companion.bench.perception import TO_8, Tally, Trunks, score
from companion.perception.ball import ColorDetector
from companion.perception.trunks import TrunkDetector
from sitl_sim.sensors import labelled_frames

SEED = 20260


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Camera and frames: 100 single ones at any attitude, and three flights of 4 s."""
    folder = tmp_path_factory.mktemp("frames")
    labelled_frames.write(folder, SEED, 100, 0, 3, "marked")
    return load(folder)


def trunks(recorded, conditions):
    camera, frames = recorded
    measured = Trunks(camera, TrunkDetector(camera).detect)
    for frame in frames:
        if frame.conditions == conditions:
            measured.add(frame, frame.image())
    return measured.table()


def test_marked_drones_to_8_m(recorded):
    camera, frames = recorded
    detector, bands = ColorDetector(camera), {TO_8: Tally()}
    for frame in frames:
        if frame.conditions == "clean":
            score(bands, detector.detect(frame.image()), frame.drones)
    figures = bands[TO_8].figures()
    assert figures["wanted"] > 200
    assert figures["recall"] >= 0.97
    assert figures["precision"] >= 0.98
    assert figures["bearing_rms_deg"] <= 0.5
    assert figures["range_error_median"] <= 0.025
    assert abs(figures["range_bias_median"]) <= 0.01
    assert figures["range_error_p95_sigma"] < 2.0  # the stated uncertainty is that of the errors


def test_trunks_in_flight(recorded):
    table = trunks(recorded, "sequence")
    near, whole = table["2–5 m"], table["0–8 m"]
    assert near["wanted"] > 40
    assert near["recall"] == 1.0
    assert whole["recall"] >= 0.97
    assert whole["precision"] >= 0.92
    assert whole["range_error_median"] <= 0.03


def test_trunks_at_any_attitude(recorded):
    whole = trunks(recorded, "clean")["0–8 m"]
    assert whole["wanted"] > 100
    assert whole["recall"] >= 0.92
    assert whole["range_error_median"] <= 0.05
