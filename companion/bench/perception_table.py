"""`companion bench perception`: detection, tracking and trunks on labelled frames, as tables."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from companion.types import Image, Trunk
    from mavlink_bridge.shared.arrays import Vector

EXIT_BAD_INPUT = 2
_DRONE_COLUMNS = {
    "recall": "recall",
    "precision": "precision",
    "bearing_rms_deg": "bearing°",
    "range_error_median": "|range| med",
    "range_bias_median": "bias",
    "range_error_p95": "p95",
    "velocity_rmse_m_s": "velocity",
    "wanted": "n",
}


def add_arguments(perception: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    source = perception.add_mutually_exclusive_group()
    source.add_argument("--frames", type=Path, metavar="DIR", help="labelled frames to measure on")
    source.add_argument(
        "--videos",
        type=Path,
        metavar="DIR",
        help="real videos V_CLASS_NNN.mp4 and labels, of which those of odd number are measured",
    )
    source.add_argument("--seed", type=int, default=20260, help="of the rendered frames (20260)")
    perception.add_argument(
        "--count", type=int, default=200, help="number of clean rendered frames (200)"
    )
    perception.add_argument(
        "--looks",
        metavar="NAMES",
        help="render worlds in these looks (comma-separated, or all) with five bodies, --count "
        "of each: a table by look",
    )
    perception.add_argument(
        "--open-ground",
        action="store_true",
        help="with --looks: worlds with few trunks or none, where the horizon shows",
    )
    perception.add_argument(
        "--detector",
        choices=["color", "cnn", "network", "yolo"],
        default="network",
        help="(network, which the packaged scenarios fly)",
    )
    perception.add_argument("--model", help="ONNX file of cnn, network or yolo")
    perception.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Render frames where none are given, measure, print; return the exit status."""
    import cv2

    from companion.bench.labels import LabelError
    from companion.perception.camera import CalibrationError
    from companion.perception.detectors import ModelError

    cv2.setNumThreads(1)
    try:
        if options.videos is not None:
            figures = _measure_videos(options)
            print(json.dumps(figures, indent=1) if options.json else "\n".join(_shown(figures)))
            return 0
        if options.frames is not None:
            result = _measure(options.frames, options)
        else:
            with tempfile.TemporaryDirectory() as folder:
                _render(Path(folder), options)
                result = _measure(Path(folder), options)
    except (CalibrationError, LabelError, ModelError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    print(json.dumps(result, indent=1) if options.json else "\n".join(_lines(result)))
    return 0


def _render(folder: Path, options: argparse.Namespace) -> None:
    """Render frames into `folder` by `sitl-sim frames`; the siblings meet on the disk."""
    from companion.bench.labels import LabelError

    looks = "marked" if options.detector == "color" else "bare"
    seed, count = str(options.seed), str(options.count)
    arguments = [str(folder), "--seed", seed, "--count", count, "--looks", looks]
    if options.looks is not None:
        arguments = [str(folder), "--seed", seed, "--count", count]
        arguments += ["--look", options.looks, "--bodies", "all"]
        arguments += ["--open-ground"] if options.open_ground else []
    command = [sys.executable, "-m", "sitl_sim", "frames", *arguments]
    done = subprocess.run(command, stdout=sys.stderr)
    if done.returncode:
        raise LabelError(
            "no frames: `sitl-sim frames` failed; is the `sim` extra installed? "
            "--frames DIR measures on other frames"
        )


def _measure(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of the detector named in `options` on a folder of frames."""
    from companion.bench.labels import load
    from companion.bench.looks import by_look
    from companion.bench.perception import measure
    from companion.perception.cnn import CnnDetector
    from companion.perception.config import SensingConfig
    from companion.perception.detectors import make_detector
    from companion.perception.network_search import NetworkSearch
    from companion.perception.trunks import TrunkDetector
    from companion.perception.yolo import YoloDetector

    camera, frames = load(folder)
    sensing = SensingConfig(detector=options.detector, model=options.model)
    detector = make_detector(camera, sensing)
    compared: dict[str, Callable[[Image], object]] = {
        "color": make_detector(camera, SensingConfig()).detect
    }
    if isinstance(detector, CnnDetector | YoloDetector):
        network = detector.network
        compared["forward_pass"] = lambda _: network.forward()
    trunks = TrunkDetector(camera)
    finder: TrunkDetector | NetworkSearch = trunks
    find: Callable[[Image, Vector, float], list[Trunk]] = trunks.detect
    if isinstance(detector, NetworkSearch):
        find, finder = detector.find, detector
    figures = measure(camera, frames, detector, compared, find)
    result = {"detector": options.detector, **figures}
    if looks := by_look(camera, frames, detector, find, lambda: finder.clarity):
        result["looks"] = looks
    whole = result["time_ms"]["detect_track"]
    if whole is not None:
        result["times_as_long_as"] = {
            name: whole["p50"] / result["time_ms"][name]["p50"] for name in compared
        }
    return result


def _measure_videos(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of the detector named in `options` on real videos."""
    from companion.bench.videos import measure_videos
    from companion.perception.camera import Camera
    from companion.perception.config import SensingConfig
    from companion.perception.detectors import make_detector

    # Their drones are of any size: none is too far.
    far = {"max_range": 1000.0}
    given = {"detector": options.detector, "model": options.model, "cnn": far, "network": far}
    camera = Camera.equidistant(640, 400)
    detector = make_detector(camera, SensingConfig.model_validate(given))
    return {"detector": options.detector, **measure_videos(options.videos, detector, camera)}


def _shown(figures: dict[str, Any]) -> list[str]:
    """Return the figures of videos as lines of text."""

    def share(value: float | None) -> str:
        return "–" if value is None else f"{value:.3f}"

    lines = [f"{figures['detector']}, {figures['pictures']} pictures"]
    for size, row in figures["drones"].items():
        lines.append(f"  drones {size:12s} recall {share(row['recall'])}   n {row['wanted']}")
    for name, row in figures["others"].items():
        taken = share(row["taken_for_drones"])
        lines.append(f"  {name:19s} taken for drones {taken}   n {row['shown']}")
    return [*lines, f"  false per picture {share(figures['false_per_picture'])}"]


def _lines(result: dict[str, Any]) -> list[str]:
    """Return the tables as lines of text."""
    lines = []
    for name, table in result["drones"].items():
        if name not in ("clean", "sequence"):  # the wide bands are enough
            table = {band: f for band, f in table.items() if band in ("0.3–8 m", "0.3–10 m")}
        lines += _table(f"{result['detector']}, {name}", table, "velocity_rmse_m_s")
    of_range = [column for column in _DRONE_COLUMNS if column.startswith("range")]
    if "looks" in result:
        from companion.bench.looks import lines as look_lines

        return look_lines(result["looks"])
    lines += _table("with tracking", result["tracks"], "bearing_rms_deg", *of_range)
    of_drones = ("bearing_rms_deg", "velocity_rmse_m_s")
    lines += _table("trunks, by surface distance", result["trunks"], *of_drones)
    crowds = {f"{n} neighbours": t for n, t in result["scaling_ms"].items()}
    for name, t in {**result["time_ms"], **crowds}.items():
        if t is not None:
            lines.append(f"{name:16s} p50 {t['p50']:6.2f} ms   p99 {t['p99']:6.2f} ms")
    for name, ratio in result.get("times_as_long_as", {}).items():
        lines.append(f"detect_track takes {ratio:.2f} times as long as {name}")
    return lines


def _table(title: str, table: dict[str, Any], *without: str) -> list[str]:
    """Return one table as lines, but for the columns in `without`."""
    columns = {k: v for k, v in _DRONE_COLUMNS.items() if k not in without}
    lines = [f"{title:28s}" + "".join(f"{head:>12s}" for head in columns.values())]
    for band, figures in table.items():
        cells = [figures[k] for k in columns]
        shown = ["–" if c is None else f"{c}" if isinstance(c, int) else f"{c:.3f}" for c in cells]
        lines.append(f"  {band:26s}" + "".join(f"{c:>12s}" for c in shown))
    return [*lines, ""]
