"""Perception by the look of the world: drones to 8 m and obstacles to 5 m, a row for each look."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from companion.bench.labels import LabelledFrame
from companion.bench.perception import TO_8, TRUNKS_TO_5, FindTrunks, Tally, Trunks, score
from companion.perception.ball import Detector
from companion.perception.camera import Camera

CLEAR = 0.5  # least clarity of a picture that the camera's health lets pass


def by_look(
    camera: Camera,
    frames: Sequence[LabelledFrame],
    detector: Detector,
    find: FindTrunks,
    clarity: Callable[[], float],
) -> dict[str, dict[str, Any]]:
    """Return figures of `drones` and `obstacles` by look; none for frames without a look.

    clarity: tells that of the picture searched last; `clear` is the share of pictures above CLEAR.
    """
    clear: dict[str, list[bool]] = {}
    drones: dict[str, dict[tuple[float, float], Tally]] = {}
    obstacles: dict[str, Trunks] = {}
    for frame in frames:
        if frame.look is None:
            continue
        image = frame.image()
        bands = drones.setdefault(frame.look, {TO_8: Tally()})
        score(bands, detector.detect(image), frame.drones)
        if frame.trunks is not None:
            obstacles.setdefault(frame.look, Trunks(camera, find)).add(frame, image)
            clear.setdefault(frame.look, []).append(clarity() >= CLEAR)
    return {
        name: {
            "drones": bands[TO_8].figures(),
            "obstacles": obstacles[name].figures(TRUNKS_TO_5) if name in obstacles else None,
            "clear": sum(clear[name]) / len(clear[name]) if name in clear else None,
        }
        for name, bands in drones.items()
    }


def lines(table: dict[str, dict[str, Any]]) -> list[str]:
    """Return the table as text: recall, precision, median error of range; share of clear ones."""
    made = [
        f"{'look':12s}  drones to 8 m: recall  precision  |range|    obstacles to 5 m: the same"
        "   clear"
    ]
    for name, row in table.items():
        share = "–" if row["clear"] is None else f"{row['clear']:.2f}"
        cells = [_cells(row["drones"]), _cells(row["obstacles"]), share]
        made.append(f"{name:12s}  {'   '.join(cells)}")
    return made


def _cells(figures: dict[str, Any] | None) -> str:
    if figures is None:
        return "not labelled"
    keys = ("recall", "precision", "range_error_median")
    values = [figures[key] for key in keys]
    text = " ".join("     –" if value is None else f"{value:6.3f}" for value in values)
    return f"{text} (n {figures['wanted']})"
