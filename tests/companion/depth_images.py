"""Depth images of cylinders and walls, as `DepthReader` reads them."""

import numpy as np

from companion.perception.camera import Camera
from companion.perception.depth import DepthConfig, DepthReader
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

CAMERA = Camera.equidistant(640, 400)
LENS = CAMERA.scaled(160, 100)
LEVEL = np.array([1.0, 0, 0, 0])
NO_TRUNKS = np.zeros((0, 3))


def state(p, q=LEVEL, time=0.0):
    return VehicleState(time, np.array(p, float), np.zeros(3), np.array(q, float), np.zeros(3))


def rays(q=LEVEL):
    """(100,160,3) world directions of the depth image's pixels."""
    return LENS.directions.astype(float) @ (rotation_matrix(q) @ rotation_matrix(CAMERA.mount)).T


def to_cylinder(p, d, x, y, radius):
    """Range [m] from p (3,) along the directions d (...,3) to an upright cylinder; inf past it."""
    a, f = (d[..., :2] ** 2).sum(-1), p[:2] - np.array([x, y])
    b = d[..., :2] @ f
    root = b * b - a * (f @ f - radius**2)
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (t > 0), t, np.inf)


def to_planes(p, d, planes):
    """Range [m] to the nearest of walls n·x = b seen from their free side."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = [(b - np.dot(n, p)) / (d @ np.array(n, float)) for n, b in planes]
    return np.min([np.where(x > 0, x, np.inf) for x in t], axis=0)


def read(depth, p, q=LEVEL, drones=()):
    """Trunks and ranges of a depth image taken at p (3,) m with attitude q."""
    r_wc = rotation_matrix(np.array(q)) @ rotation_matrix(CAMERA.mount)
    return DepthReader(CAMERA, DepthConfig()).read(depth.astype(np.float32), r_wc, p[2], drones)
