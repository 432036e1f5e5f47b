"""The flight as a 3-D scene; one object draws all drones, so that 20 stay smooth."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Belief
from sitl_sim.figures.curves import colours, rgb, shared_targets
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.viewer import meshes
from sitl_sim.viewer.sources import Moment

_BARK, _TARGET, _THREAT = (135, 115, 85), (208, 0, 0), (230, 30, 30)
_TALL = 100.0  # m: taller trunks are cut off
_VIEW_REACH = 2.5  # m of the field of view that are drawn


class Scene:
    """Everything drawn of a flight; `show` moves it to a moment."""

    def __init__(
        self, server: viser.ViserServer, scenario: Scenario, world: dict[str, Any], names: list[str]
    ) -> None:
        self._scene = server.scene
        self.layers = dict.fromkeys(
            ("fields of view", "plans", "threats", "tracks", "trails"), True
        )
        self.colours = np.array([rgb(c) for c in colours(len(names))], np.uint8)
        self._surroundings(world)
        n = len(names)
        q, p = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
        shape, faces = meshes.quadrotor(world["drone_radius"])
        self.drones = self._scene.add_batched_meshes_simple(
            "/drones",
            shape,
            faces,
            q,
            p,
            batched_colors=self.colours,
            side="double",
            lod="off",
        )
        fan, faces = meshes.view_fan(np.radians(scenario.sensing.fov_deg) / 2, _VIEW_REACH)
        self.views = self._scene.add_batched_meshes_simple(
            "/views",
            fan,
            faces,
            q,
            p,
            batched_colors=self.colours,
            side="double",
            lod="off",
            opacity=0.15,
            cast_shadow=False,
            receive_shadow=False,
        )
        self._labels = [
            self._scene.add_label(f"/labels/{name}", name.removeprefix("drone")) for name in names
        ]
        self.trails = self._lines("/trails", 0.02)
        self.plans = self._lines("/plans", 0.03)
        self.threats = self._lines("/threats", 0.03)
        nowhere = np.zeros((1, 3), np.float32)
        self.tracks = self._scene.add_point_cloud(
            "/tracks", nowhere, _THREAT, point_size=0.15, point_shape="circle", visible=False
        )

    def show(self, moment: Moment, beliefs: list[Belief | None], chosen: int) -> None:
        """Draw the truth, each companion's plan and threats, and the tracks of the chosen drone."""
        p, q = moment.p.astype(np.float32), moment.q.astype(np.float32)
        for group in (self.drones, self.views):
            group.batched_positions, group.batched_wxyzs = p, q
        for label, at in zip(self._labels, moment.p, strict=True):
            label.position = at + np.array([0.0, 0.0, 0.35])
        self.views.visible = self.layers["fields of view"]
        self._draw("trails", self.trails, list(_segments(moment.trail)), 0.5)
        self._draw(
            "plans",
            self.plans,
            [_segments(m.plan[None])[0] if m and len(m.plan) else _NONE for m in beliefs],
            1.0,
        )
        belief = beliefs[chosen]
        self.tracks.visible = (
            self.layers["tracks"] and belief is not None and len(belief.tracks) > 0
        )
        if belief is not None and len(belief.tracks):
            self.tracks.points = belief.tracks.astype(np.float32)
            self.tracks.colors = np.tile(self.colours[chosen], (len(belief.tracks), 1))
        edges = [
            (at, t.position)
            for at, m in zip(moment.p, beliefs, strict=True)
            if m
            for t in m.critical
        ]
        points = np.array(edges, np.float32).reshape(-1, 2, 3)
        self.threats.visible = self.layers["threats"] and bool(len(points))
        if len(points):
            self.threats.points = points
            self.threats.colors = np.full(points.shape, _THREAT, np.uint8)

    def _draw(
        self, layer: str, lines: viser.LineSegmentsHandle, paths: list[Vector], strength: float
    ) -> None:
        """Draw a path for each drone in its colour."""
        points = np.concatenate(paths).astype(np.float32)
        lines.visible = self.layers[layer] and bool(len(points))
        if len(points):
            colour = np.repeat(self.colours, [len(path) for path in paths], axis=0) * strength
            lines.points = points
            lines.colors = np.repeat(colour.astype(np.uint8)[:, None], 2, axis=1)

    def _lines(self, name: str, thickness: float) -> viser.LineSegmentsHandle:
        nothing = np.zeros((1, 2, 3), np.float32)
        return self._scene.add_line_segments(
            name, nothing, nothing.astype(np.uint8), thickness=thickness, visible=False
        )

    def _surroundings(self, world: dict[str, Any]) -> None:
        """Draw ground, obstacles and targets."""
        self._scene.set_up_direction("+z")
        self._scene.configure_environment_map("studio", environment_intensity=0.12)
        self._scene.configure_default_lights(True)
        places = [(c["x"], c["y"]) for c in world["cylinders"]]
        places += [b[k][:2] for b in world["boxes"] for k in ("min", "max")]
        centre = np.mean(places or [(0.0, 0.0)], axis=0)
        self._scene.add_grid(
            "/ground",
            80.0,
            80.0,
            cell_size=1.0,
            section_size=10.0,
            position=(float(centre[0]), float(centre[1]), 0.0),
        )
        if world["cylinders"]:
            c = np.array(
                [[k["x"], k["y"], k["radius"], min(k["height"], _TALL)] for k in world["cylinders"]]
            )
            shape, faces = meshes.cylinder()
            self._scene.add_batched_meshes_simple(
                "/trunks",
                shape,
                faces,
                np.tile([1.0, 0.0, 0.0, 0.0], (len(c), 1)),
                np.column_stack([c[:, :2], np.zeros(len(c))]),
                batched_scales=np.column_stack([c[:, 2], c[:, 2], c[:, 3]]).astype(np.float32),
                batched_colors=_BARK,
                lod="off",
                opacity=0.6,
            )
        for n, b in enumerate(world["boxes"]):
            low, high = np.array(b["min"]), np.array(b["max"])
            self._scene.add_box(
                f"/boxes/{n}",
                _BARK,
                dimensions=tuple(high - low),
                position=tuple((low + high) / 2),
                opacity=0.6,
            )
        for n, target in enumerate(shared_targets(world)):
            self._scene.add_icosphere(f"/targets/{n}", 0.25, _TARGET, position=np.array(target))


_NONE = np.zeros((0, 2, 3))


def _segments(paths: Vector) -> NDArray[np.float64]:
    """Return paths (N,K,3) as segments (N,K-1,2,3)."""
    return np.stack([paths[:, :-1], paths[:, 1:]], axis=2)
