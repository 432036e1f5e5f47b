"""Cameras in the swarm's log: pictures, and what each companion found in them.

Pictures are rendered from the truth, for a companion logs few of its own; at the instants of
frames that it has seen, so that viewers lay its detections over them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations

from sitl_sim.recording.run_folder import OwnFrame, Run
from sitl_sim.scenarios.sensing import lens_of
from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.renderers import make_renderer

_PERIOD = 1.0  # s between two pictures of a camera
_QUALITY = 70  # of JPEG
_DRONE, _OBSTACLE = (0.3, 1.0, 0.3), (1.0, 0.6, 0.2)  # RGB
_TRUNK_SIZE = 0.3  # rad, of the ring around an obstacle
Put = Callable[[str, float, Any], None]


def write_cameras(put: Put, run: Run, frames: dict[str, OwnFrame]) -> None:
    """Write `/NAME/annotations` of each frame and `/truth/NAME/camera` once a second."""
    lens, s = lens_of(run.scenario.sensing), run.scenario
    renderer = make_renderer(run.world, s.world.look, s.drones.look, s.seed, lens)
    t = run.truth["t"]
    p, q = (run.truth[k].astype(float) for k in ("position", "attitude"))
    for i, (name, frame) in enumerate(frames.items()):
        shown = -np.inf
        for record in run.logs[name]:
            if record.get("frame") is None:
                continue
            time = max(record["frame"] - frame.boot, 0.0)
            radius = run.world["drone_radius"]
            put(f"/{name}/annotations", time, _annotations(record, lens, radius))
            if time - shown >= _PERIOD - 1e-6:
                shown = time
                k = min(int(np.searchsorted(t, time - 1e-6)), len(t) - 1)
                picture = CompressedImage(format="jpeg", frame_id=f"{name}/true")
                image = renderer.render(p[k, i], q[k, i], p[k], q[k])
                _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
                picture.data = coded.tobytes()
                put(f"/truth/{name}/camera", time, picture)


def _annotations(record: dict[str, Any], lens: Lens, radius: float) -> ImageAnnotations:
    """Return rings around what was found: green drones, orange obstacles, with distances [m]."""
    made = ImageAnnotations()
    for key, colour in (("trunks", _OBSTACLE), ("detections", _DRONE)):
        for x, y, z, distance, *_ in record[key]:
            u, v = lens.project(np.array([x, y, z]))[0]
            size = _TRUNK_SIZE if key == "trunks" else radius / max(distance, radius)
            ring = made.circles.add(diameter=max(2 * size * lens.f, 8.0), thickness=1.5)
            ring.position.x, ring.position.y = float(u), float(v)
            text = made.texts.add(text=f"{distance:.1f}", font_size=12.0)
            text.position.x, text.position.y = float(u) + ring.diameter / 2, float(v)
            for c in (ring.outline_color, text.text_color):
                c.r, c.g, c.b, c.a = *colour, 1.0
    return made
