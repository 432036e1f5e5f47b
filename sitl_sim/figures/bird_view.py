"""The swarm in perspective, from above and behind: what is true, for the video."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.curves import shared_targets

BACKGROUND, GRID, WHITE = (40, 33, 27), (66, 56, 47), (235, 235, 235)  # BGR
RED = (80, 80, 240)
BARK, TOP = (70, 101, 133), (120, 160, 196)
_CUT = 3.0  # m: obstacles are drawn up to here
_PITCH = np.radians(42.0)  # how steeply the camera looks down
_SIDES = 20  # of a drawn cylinder
_SMALLEST = 5  # px, radius of a drawn drone
_ENLARGED = 2.0  # times its size that a drone is drawn
_SHIFT = 4  # fractional bits of OpenCV's coordinates
Image = NDArray[np.uint8]
Colour = tuple[int, int, int]


class BirdView:
    """Draws the truth; the camera stands still and shows the whole flight."""

    def __init__(self, world: dict[str, Any], path: Vector, size: tuple[int, int]) -> None:
        """Choose the camera.

        path: (n,3) m, where drones fly. size: (width, height) px.
        """
        self._size = size
        low, high = path.min(axis=0) - 2.0, path.max(axis=0) + 2.0
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                            for z in (0.0, high[2])])  # fmt: skip
        self._forward = np.array([0.0, np.cos(_PITCH), -np.sin(_PITCH)])
        self._up = np.array([0.0, np.sin(_PITCH), np.cos(_PITCH)])
        self._focal = 1.1 * min(size)
        middle = np.append((low + high)[:2] / 2, 0.0)
        for distance in np.geomspace(4.0, 400.0, 90):
            self._eye = middle - distance * self._forward
            u, depth = self.project(corners)
            inside = (u > 0.02 * np.array(size)).all() and (u < 0.98 * np.array(size)).all()
            if inside and (depth > 1.0).all():
                break
        self._still = self._surroundings(world, low, high)

    def project(self, points: Vector) -> tuple[Vector, Vector]:
        """Return pixels (n,2) and depth [m] (n,) of points (n,3) m."""
        offset = np.asarray(points, float) - self._eye
        depth = offset @ self._forward
        safe = np.maximum(depth, 0.05)
        right = self._focal * offset[:, 0] / safe + self._size[0] / 2
        down = self._size[1] / 2 - self._focal * (offset @ self._up) / safe
        return np.stack([right, down], axis=1), depth

    def draw(
        self, p: Vector, trails: Vector, colours: NDArray[np.int_], radius: float, chosen: int
    ) -> Image:
        """Return a picture of drones at p (N,3) m with trails (N,k,3) m; one of them is ringed.

        colours: (N,3) BGR. radius: of a drone [m].
        """
        image = self._still.copy()
        for trail, colour in zip(trails, colours, strict=True):
            u, _ = self.project(trail)
            _line(image, u, _bgr(colour), 2)
        u, depth = self.project(p)
        ground, _ = self.project(p * [1, 1, 0])
        for i in np.argsort(-depth):
            colour = _bgr(colours[i])
            size = max(round(_ENLARGED * radius * self._focal / depth[i]), _SMALLEST)
            _line(image, np.array([u[i], ground[i]]), GRID, 1)
            _quadrotor(image, u[i], size, colour)
            if i == chosen:
                cv2.circle(image, _fixed(u[i]), (size + 5) << _SHIFT, WHITE, 2, cv2.LINE_AA, _SHIFT)
        return image

    def mark(self, image: Image, place: Vector, colour: Colour) -> None:
        """Draw a ring around a place (3,) m."""
        u, _ = self.project(place[None])
        cv2.circle(image, _fixed(u[0]), 26 << _SHIFT, colour, 3, cv2.LINE_AA, _SHIFT)

    def _surroundings(self, world: dict[str, Any], low: Vector, high: Vector) -> Image:
        """Return a picture of ground, targets and obstacles."""
        image = np.full((self._size[1], self._size[0], 3), BACKGROUND, np.uint8)
        first, last = np.floor(low / 5) * 5 - 5, np.ceil(high / 5) * 5 + 5
        for x in np.arange(first[0], last[0] + 1, 5.0):
            _line(image, self.project(np.array([[x, first[1], 0], [x, last[1], 0]]))[0], GRID, 1)
        for y in np.arange(first[1], last[1] + 1, 5.0):
            _line(image, self.project(np.array([[first[0], y, 0], [last[0], y, 0]]))[0], GRID, 1)
        for number, (x, y, z) in enumerate(shared_targets(world), start=1):
            ring = np.array([x, y, z]) + world["target_tolerance"] * _circle()
            u, _ = self.project(ring)
            _line(image, np.vstack([u, u[:1]]), RED, 2)
            at, _ = self.project(np.array([[x, y, z]]))
            write(image, str(number), at[0] - [6, -7], 0.7, RED)
        solids = [*map(_cylinder, world["cylinders"]), *map(_box, world["boxes"])]
        solids = [s for s in solids if self.project(s)[1].min() > 0.5]
        for solid in sorted(solids, key=lambda s: -self.project(s)[1].mean()):
            u, _ = self.project(solid)
            half = len(u) // 2
            cv2.fillConvexPoly(image, _hull(u), BARK, cv2.LINE_AA, _SHIFT)
            cv2.fillConvexPoly(image, _hull(u[half:]), TOP, cv2.LINE_AA, _SHIFT)
        return image


def write(image: Image, text: str, at: Any, scale: float, colour: Colour = WHITE) -> None:
    """Write text with its left end on the line at a pixel (2,)."""
    place = (round(float(at[0])), round(float(at[1])))
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)


def _quadrotor(image: Image, at: Vector, size: int, colour: Colour) -> None:
    """Draw a body and four propellers, `size` px from the middle to a tip."""
    for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        tip = at + 0.62 * size * np.array([x, 0.7 * y])
        _line(image, np.array([at, tip]), colour, 1)
        radius = round(0.42 * size * (1 << _SHIFT))
        cv2.circle(image, _fixed(tip), radius, colour, -1, cv2.LINE_AA, _SHIFT)


def _bgr(colour: NDArray[np.int_]) -> Colour:
    blue, green, red = map(int, colour)
    return blue, green, red


def _circle() -> Vector:
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)])


def _cylinder(c: dict[str, float]) -> Vector:
    """Return the lower rim and then the upper rim of a cylinder, as drawn."""
    rim = np.array([c["x"], c["y"], 0.0]) + c["radius"] * _circle()
    return _between(rim, 0.0, min(c["height"], _CUT))


def _box(b: dict[str, list[float]]) -> Vector:
    """Return the lower and then the upper corners of a box, as drawn."""
    (x0, y0, z0), (x1, y1, z1) = b["min"], b["max"]
    flat = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
    bottom = min(z0, _CUT)
    return _between(flat, bottom, max(min(z1, _CUT), bottom))


def _between(flat: Vector, low: float, high: float) -> Vector:
    """Return an outline (n,3) m on the ground at two heights [m], (2n,3) m."""
    return np.vstack([np.add(flat, [0, 0, low]), np.add(flat, [0, 0, high])])


def _hull(u: Vector) -> NDArray[np.int32]:
    made: NDArray[np.int32] = cv2.convexHull((u * (1 << _SHIFT)).round().astype(np.int32))  # type: ignore[assignment]
    return made


def _fixed(u: Vector) -> tuple[int, int]:
    x, y = np.clip(u, -1e4, 1e4) * (1 << _SHIFT)
    return round(x), round(y)


def _line(image: Image, u: Vector, colour: Colour, width: int) -> None:
    points = (np.clip(u, -1e4, 1e4) * (1 << _SHIFT)).round().astype(np.int32)
    cv2.polylines(image, [points], False, colour, width, cv2.LINE_AA, _SHIFT)
