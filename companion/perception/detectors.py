"""The detectors of drones, by their names in the configuration."""

from __future__ import annotations

from pathlib import Path

from companion.perception.ball import ColorDetector, Detector
from companion.perception.camera import Camera
from companion.perception.config import SensingConfig
from companion.perception.networks import ModelError

__all__ = ["Detector", "ModelError", "make_detector"]


def make_detector(camera: Camera, sensing: SensingConfig) -> Detector:
    """Return the detector that `sensing.detector` names.

    Raises:
        ModelError: a model file that cannot be used.
    """
    model = Path(sensing.model) if sensing.model else None
    if sensing.detector == "network":
        from companion.perception.network_search import NetworkSearch

        return NetworkSearch(camera, sensing)
    if sensing.detector == "cnn":
        from companion.perception.cnn import PACKAGED, CnnDetector

        return CnnDetector(camera, sensing.cnn, model or PACKAGED)
    if sensing.detector == "yolo":
        from companion.perception.yolo import YoloDetector

        assert model is not None  # the configuration demands it
        return YoloDetector(camera, sensing.yolo, model)
    return ColorDetector(camera, sensing.color)
