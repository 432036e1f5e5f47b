"""The detectors of drones by name, packaged and of users: `sensing.detector` of a drone's file.

A detector is called with a `DetectorSetup`; its `detect` returns the drones in a picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.perception.ball import ColorDetector, Detector
from companion.perception.camera import Camera
from companion.perception.config import DETECTORS, SensingConfig
from companion.perception.networks import ModelError
from companion.types import Detection
from mavlink_bridge.wire.video import Frame

__all__ = ["Detector", "DetectorSetup", "ModelError", "make_detector", "reported"]


@dataclass(frozen=True)
class DetectorSetup:
    """What a detector is made from.

    camera: of the pictures; `unproject` turns pixels into directions. sensing: the
    whole section of the drone's file. options: `sensing.detector_options`, as written.
    """

    camera: Camera
    sensing: SensingConfig
    options: Mapping[str, Any]

    @property
    def model(self) -> Path | None:
        """The file that `sensing.model` names."""
        return Path(self.sensing.model) if self.sensing.model else None


def make_detector(camera: Camera, sensing: SensingConfig) -> Detector:
    """Return the detector that `sensing.detector` names.

    Raises:
        ModelError: a model file that cannot be used.
        PartError: a user's detector that cannot be used.
    """
    setup = DetectorSetup(camera, sensing, sensing.detector_options)
    made: Detector = DETECTORS.load(sensing.detector)(setup)
    return made


def reported(frame: Frame) -> list[Detection]:
    """Return the neighbours that come with a frame: of a simulator's perfect sensing, or a replay.

    Each row has the direction, range, sigma_bearing and sigma_range of a `Detection`, and of a
    replay sigma_lasting, too.
    """
    rows = frame.arrays["neighbours"].tolist() if "neighbours" in frame.arrays else []
    return [Detection(np.array(r[:3]), r[3], r[4], r[5], 1.0, *r[6:7]) for r in rows]


def color(setup: DetectorSetup) -> Detector:
    """Return the detector of colour markers."""
    return ColorDetector(setup.camera, setup.sensing.color)


def network(setup: DetectorSetup) -> Detector:
    """Return the packaged network that finds drones and obstacles."""
    from companion.perception.network_search import NetworkSearch

    return NetworkSearch(setup.camera, setup.sensing)


def cnn(setup: DetectorSetup) -> Detector:
    """Return the packaged network that finds drones alone."""
    from companion.perception.cnn import PACKAGED, CnnDetector

    return CnnDetector(setup.camera, setup.sensing.cnn, setup.model or PACKAGED)


def yolo(setup: DetectorSetup) -> Detector:
    """Return the detector of the user's YOLO network."""
    from companion.perception.yolo import YoloDetector

    assert setup.model is not None  # the configuration demands it
    return YoloDetector(setup.camera, setup.sensing.yolo, setup.model)
