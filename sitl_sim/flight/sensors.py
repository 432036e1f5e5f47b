"""What the drones' sensors deliver: rendered pictures and depth, or a perfect detector's report."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import multiply
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.scenarios.sensing import lens_of
from sitl_sim.sensors import perfect_detector as detector
from sitl_sim.sensors.renderers import Pictures, make_renderer
from sitl_sim.sensors.sensor import measured
from sitl_sim.worlds.world import Occluders

Capture = tuple[float, dict[str, NDArray[Any]]]
"""Capture time [s, vehicle's clock], and the arrays of a frame."""


class Sensors:
    """The forward sensors of all drones of a scenario in its world."""

    def __init__(self, scenario: Scenario, world: dict[str, Any], renders: bool = True) -> None:
        """Prepare them; renders: False where other processes render the pictures.

        Raises:
            SettingsError: the cameras' calibration cannot be used.
        """
        s = self._sensing = scenario.sensing
        self._occluders = Occluders(world)
        self._walls = detector.WallRanges(self._occluders, s.width, s.height, s.fov_deg)
        half = np.radians(s.fov_deg) / 2
        self._view = (half, half * s.height / s.width)
        self._cameras = s.actual.drawn(scenario.drones.count, scenario.seed)
        self._renderers: dict[float, Pictures] = {}  # by the factor on the focal length
        if "camera" in (s.neighbours, s.obstacles) or s.obstacles == "depth":
            lens = lens_of(s)
            for factor in {c.focal for c in self._cameras} if renders else set():
                self._renderers[factor] = make_renderer(
                    world,
                    scenario.world.look,
                    scenario.drones.look,
                    scenario.seed,
                    lens.zoomed(factor),
                )

    @property
    def renders(self) -> bool:
        """Whether a picture or a depth image has to be rendered."""
        return bool(self._renderers)

    def stamp_error(self, i: int) -> float:
        """Return by how much [s] the stamps of drone i's camera are after the capture."""
        return self._cameras[i].stamp

    def warm_up(self, p: Vector, q: Vector) -> None:
        """Deliver a frame of each drone to nobody; p: (n,3) m and q: (n,4) of all drones, world.

        The first one loads compiled kernels for seconds: in real time the world would lag behind
        its autopilots by as much, and companions would wait for a picture of their present.
        """
        for i in range(len(p)):
            self.frame(i, 0.0, p, q)

    def frame(self, i: int, stamp: float, p: Vector, q: Vector) -> dict[str, NDArray[Any]]:
        """Return the arrays of drone i's frame, named as in `mavlink_bridge.wire.video`.

        stamp: capture time [s] on the drone's clock. p: (n,3) m and q: (n,4) of all drones, world.
        """
        s, camera = self._sensing, self._cameras[i]
        renderer = self._renderers.get(camera.focal)
        looks = multiply(q[i], camera.turn)  # where the drone's nose would be, were it the camera's
        others = np.delete(np.arange(len(p)), i)
        arrays: dict[str, NDArray[Any]] = {}
        seed = round(stamp * 1e3) * 64 + i
        if renderer is not None and "camera" in (s.neighbours, s.obstacles):
            arrays["image"] = renderer.render(
                p[i],
                looks,
                p[others],
                q[others],
                frame_seed=seed,
                drones_id=[int(o) for o in others],
            )
        if renderer is not None and s.obstacles == "depth":
            height = round(s.depth.width * s.height / s.width)
            depth = renderer.depth(p[i], looks, p[others], q[others], s.depth.width, height)
            arrays["depth"] = measured(depth, s.depth.range, s.depth.noise, seed)
        if s.neighbours == "truth":
            arrays["neighbours"] = detector.neighbours(
                p[i], looks, p[others], self._occluders, self._view, s.range_max
            )
        if s.obstacles == "map":
            arrays["trunks"] = detector.trunks(
                p[i], looks, self._occluders, self._view, s.range_max
            )
            if self._occluders.boxes:
                arrays["ranges"] = self._walls(p[i], looks, s.range_max)
        return arrays


def captured(
    sensors: Sensors,
    camera: FaultyCamera,
    i: int,
    now: float,
    stamp: float,
    p: Vector,
    q: Vector,
) -> Capture:
    """Return what drone i's sensors see, altered by its faults; as `Sensors.frame`.

    now: s of the flight.
    """
    arrays = sensors.frame(i, stamp, p, q)
    return camera.alter(now, stamp + sensors.stamp_error(i), arrays)
