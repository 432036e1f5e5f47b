"""Neighbouring drones by the saturated ball that marked drones carry (detector: color).

`Detector` is the interface of all detectors. The camera frame is x right, y down, z forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.perception.circles import fit_circles
from companion.perception.marker_colour import ColorSettings, MarkerColour
from companion.perception.reduced import Reduced
from companion.types import Detection, Image
from mavlink_bridge.shared.arrays import Vector

# A circle through a smaller share of an outline is wrong more often than right.
_LEAST_ARC = 0.5
# A ball in plain view shows this share of its outline and, cut at `edge`, of its disc. An object
# that hides the rest also bends the circle that is fitted to what shows: the range is less certain,
# as measured on 5000 rendered detections.
_WHOLE_ARC, _WHOLE_FILL = 0.85, 0.75
# The largest blobs are fitted: a picture full of the marker's colour must not overrun the tick.
_MOST_BLOBS = 40
# Share of the least chroma that a small ball still has in a pixel of half the size; what is looked
# at around it, in such pixels. Green ground takes chroma away: of 1473 drawn balls before it, 10
# are lost, all farther than 16 m.
_TRACE = 0.4
_AROUND = np.ones((5, 5), np.uint8)
# Two outlines are of one ball where their middles differ by less than this share of the larger
# angle, and the angles by less than this factor: a body through the middle of a ball parts it in
# two. Of a second ball so near behind the first less than a third would show.
_SAME_PLACE, _SAME_ANGLE = 0.5, 1.33
# Rows and columns of two pixels at each corner of a patch.
_CORNERS = np.array([0, 0, -1, -1] * 2), np.array([0, -1, 0, -1, 1, -2, 1, -2])
Pixels = NDArray[np.float32]
Box = tuple[int, int, int, int]  # x, y, w, h: px
Cone = tuple[Vector, float, float]  # axis, angle, arc of a `_Ball`


class Detector(Protocol):
    """Finds drones in a frame."""

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, camera frame."""
        ...


@dataclass(frozen=True)
class _Ball:
    """A ball's outline as a cone.

    axis: (3,) unit vector, camera frame. angle: rad, half its opening. arc: share seen, 0…1. fill:
    solid angle of its blob over that of all balls in it. pixel: rad, at its place. clipped: whether
    the frame cuts the blob. colour: as `MarkerColour` sees it. spread: of the angles that its parts
    have, over the angle.
    """

    axis: Vector
    angle: float
    arc: float
    fill: float
    pixel: float
    clipped: bool
    colour: tuple[float, float]
    spread: float = 0.0

    @property
    def plain(self) -> bool:
        """Return whether it is in plain view, and not small."""
        whole = self.arc > _WHOLE_ARC and self.fill > _WHOLE_FILL and not self.clipped
        return whole and self.angle > 2.0 * self.pixel

    def same_as(self, other: _Ball) -> bool:
        """Return whether both are parts of one ball."""
        small, large = sorted((self.angle, other.angle))
        off = math.dist(self.axis.tolist(), other.axis.tolist())
        return off < _SAME_PLACE * large and large < _SAME_ANGLE * small

    def joined(self, other: _Ball) -> _Ball:
        """Return the ball of which both are parts: what lies between them hides no outline."""
        share = self.arc / max(self.arc + other.arc, 1e-9)
        axis = share * self.axis + (1.0 - share) * other.axis
        return replace(
            self,
            axis=axis / math.sqrt(float(axis @ axis)),
            angle=share * self.angle + (1.0 - share) * other.angle,
            arc=min(self.arc + other.arc, 1.0),
            fill=1.0,
            clipped=self.clipped or other.clipped,
            spread=max(self.spread, abs(self.angle / other.angle - 1.0)),
        )


class ColorDetector:
    """Finds saturated balls: chroma threshold, blobs, circles through sub-pixel outlines.

    Circles on the sphere of directions are circles in its stereographic plane (`circles`).
    """

    def __init__(self, camera: Camera, settings: ColorSettings | None = None) -> None:
        self.camera = camera
        self.settings = settings or ColorSettings()
        red, green, blue = _pure(self.settings.hue_deg)
        self._pure = np.array([blue, green, red])
        self._strong = [i for i in range(3) if self._pure[i] >= 0.5]
        self._weak = [i for i in range(3) if self._pure[i] < 0.5]
        self._weights = np.zeros((1, 3), np.float32)
        self._weights[0, self._strong] = 1.0 / len(self._strong)
        self._weights[0, self._weak] = -1.0 / len(self._weak)
        # Made here, and not in the first tick.
        self._directions, self._solid_angle = camera.directions, camera.solid_angle
        self._colour = MarkerColour(self.settings)

    def detect(self, image: Image) -> list[Detection]:
        """Return the marked drones in image (H,W,3) uint8 BGR, nearest first."""
        return self.search(Reduced(image))

    def search(self, picture: Reduced) -> list[Detection]:
        """Return the marked drones in a picture, whose half size others may have made, too."""
        image = picture.image
        boxes = self._boxes(picture)
        if len(boxes) > _MOST_BLOBS:
            boxes = sorted(boxes, key=lambda box: -box[2] * box[3])[:_MOST_BLOBS]
        balls: list[_Ball] = []
        for x, y, w, h in boxes:
            for ball in self._blob(image, x, y, w, h):
                same = next((n for n, b in enumerate(balls) if b.same_as(ball)), None)
                if same is None:
                    balls.append(ball)
                else:
                    balls[same] = balls[same].joined(ball)
        credible = [(b, d) for b in balls if (d := self._detection(b)) is not None]
        plain = [ball.colour for ball, _ in credible if ball.plain]
        self._colour.after_picture(bool(credible), plain)
        return sorted((d for _, d in credible), key=lambda d: d.range)

    def _boxes(self, picture: Reduced) -> list[Box]:
        """Return the boxes around the blobs of the marker's chroma."""
        traces = self._traces(picture)
        if not traces:
            return []
        image, least = picture.image, self.settings.min_chroma
        left, top = min(x for x, *_ in traces), min(y for _, y, *_ in traces)
        right = min(max(x + w for x, _, w, _ in traces), image.shape[1])
        bottom = min(max(y + h for _, y, _, h in traces), image.shape[0])
        mask = np.zeros((bottom - top, right - left), np.uint8)
        for x, y, w, h in traces:
            # The average over neighbouring pixels keeps noise from breaking a dim ball into pieces.
            chroma = cv2.blur(self._chroma(image[y : y + h, x : x + w]), (3, 3))
            mask[y - top : y + h - top, x - left : x + w - left] |= np.asarray(
                cv2.threshold(chroma, least, 255, cv2.THRESH_BINARY)[1], np.uint8
            )
        blobs, _ = cv2.findContours(
            mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(left, top)
        )
        boxes = ((x, y, w, h) for x, y, w, h in map(cv2.boundingRect, blobs))
        return [box for box in boxes if box[2] * box[3] >= self.settings.min_area]

    def _traces(self, picture: Reduced) -> list[Box]:
        """Return the boxes in which half the picture's size shows a trace of the chroma."""
        height, width = picture.image.shape[:2]
        small = picture.colour((width + 1) // 2, (height + 1) // 2)
        least = _TRACE * self.settings.min_chroma
        trace = cv2.threshold(self._chroma(small), least, 255, cv2.THRESH_BINARY)[1]
        if not cv2.countNonZero(trace):
            return []
        outlines, _ = cv2.findContours(
            cv2.dilate(trace, _AROUND), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
        )
        return [(2 * x, 2 * y, 2 * w, 2 * h) for x, y, w, h in map(cv2.boundingRect, outlines)]

    def _chroma(self, image: Image) -> Image:
        """Return (H,W) mean of the strong channels minus mean of the weak ones, at least 0."""
        planes = cv2.split(image)
        strong, weak = (
            planes[c[0]]
            if len(c) == 1
            else cv2.addWeighted(planes[c[0]], 0.5, planes[c[1]], 0.5, 0)
            for c in (self._strong, self._weak)
        )
        return cv2.subtract(strong, weak)  # type: ignore[return-value]

    def _blob(self, image: Image, x: int, y: int, w: int, h: int) -> list[_Ball]:
        """Return the balls in one blob's bounding box [px]."""
        height, width = image.shape[:2]
        x0, y0 = max(x - 3, 0), max(y - 3, 0)
        x1, y1 = min(x + w + 3, width), min(y + h + 3, height)
        patch = image[y0:y1, x0:x1].astype(np.float32)
        # Chroma is linear in the light: a pixel half covered by the ball reads half.
        chroma: Pixels = cv2.transform(patch, self._weights)  # type: ignore[assignment]
        inside = chroma[y - y0 : y - y0 + h, x - x0 : x - x0 + w].ravel()
        quarter = min(max(2, inside.size // 4), inside.size)
        full = float(np.partition(inside, -quarter)[-quarter:].sum() / quarter)
        corners = sorted(chroma[_CORNERS].tolist())
        base = min(0.5 * (corners[3] + corners[4]), 0.3 * full)
        cover = (chroma - base) / max(full - base, 1.0)
        colour = self._colour.seen_as(cv2.mean(patch, (cover > 0.7).view(np.uint8))[:3])
        if colour is None:
            return []
        # The weight by solid angle takes the lens' stretch out of the area.
        solid = np.minimum(cover, 1.0) * (cover > 0.15) * self._solid_angle[y0:y1, x0:x1]
        area = float(solid.sum())
        clipped = x == 0 or y == 0 or x + w == width or y + h == height
        pixel = float(np.sqrt(self._solid_angle[y + h // 2, x + w // 2]))
        if area < self.settings.min_area * pixel * pixel:
            return []
        few = area < 9.0 * pixel * pixel
        cones = [] if few else self._outline(cover, x0, y0, pixel)
        cones = cones or [self._small(solid, area, x0, y0)]
        whole = sum(2.0 * math.pi * (1.0 - math.cos(angle)) for _, angle, _ in cones)
        if whole <= 0.0:
            return []
        return [_Ball(*cone, area / whole, pixel, clipped, colour) for cone in cones]

    def _outline(self, cover: Pixels, x0: int, y0: int, pixel: float) -> list[Cone]:
        """Return the balls by the outline of `cover` in a patch whose corner is pixel (x0, y0)."""
        h, w = cover.shape
        pixels = self._directions[y0 : y0 + h, x0 : x0 + w]
        rays = _crossings(cover, self.settings.edge, pixels)
        if rays.shape[1] < 8:
            return []
        middle = rays.sum(axis=1)
        middle /= math.sqrt(float(middle @ middle))
        axes = _axes(*middle.tolist())
        # Stereographic plane: circles on the sphere of directions stay circles.
        depth, px, py = axes @ rays
        scale = 2.0 / (1.0 + depth)
        px, py = px * scale, py * scale
        extent = float(max(px.max() - px.min(), py.max() - py.min()))
        cones = []
        for c in fit_circles(px, py, 0.4 * pixel + 0.02 * extent):
            radial = math.hypot(c.x, c.y)
            near, far = 2 * math.atan((radial - c.r) / 2), 2 * math.atan((radial + c.r) / 2)
            turn, angle = (near + far) / 2, (far - near) / 2
            side = math.sin(turn) / max(radial, 1e-12)
            axis = np.array([math.cos(turn), side * c.x, side * c.y]) @ axes
            cones.append((axis, angle, c.arc))
        return cones

    def _small(self, solid: Pixels, area: float, x0: int, y0: int) -> Cone:
        """Return a ball of few pixels, by centroid and area."""
        v, u = np.indices(solid.shape)
        centre = [(solid * u).sum() / area + x0, (solid * v).sum() / area + y0]
        axis = self.camera.unproject(np.array([centre]))[0]
        return axis, float(np.sqrt(area / np.pi)), 1.0

    def _detection(self, ball: _Ball) -> Detection | None:
        """Return the detection of a ball; None where it is not credible."""
        s, pixel = self.settings, ball.pixel
        if not 1e-4 < ball.angle < 1.4 or ball.arc < _LEAST_ARC:
            return None
        distance = s.marker_radius / math.sin(ball.angle)
        if distance > s.max_range:
            return None
        # Measured on 466 rendered balls up to 10 m: the circle's radius is known to some 0.06 px,
        # less well by a short arc.
        weak = 1.0 / max(ball.arc, 0.15) * (2.0 if ball.clipped else 1.0)
        sigma_angle = 0.06 * pixel * weak
        hidden = max(0.0, _WHOLE_ARC - ball.arc), max(0.0, _WHOLE_FILL - ball.fill)
        unsure = math.hypot(0.6 * hidden[0] + 0.8 * hidden[1], 0.5 * ball.spread)
        sigma_range = distance * math.hypot(0.008, sigma_angle / ball.angle, unsure)
        # A circle too large by what is hidden is off its place by as much.
        sigma_bearing = math.hypot(0.002, sigma_angle, unsure * ball.angle)
        score = min(1.0, max(0.3, ball.angle / (2.0 * pixel))) * min(1.0, 0.5 + ball.arc)
        return Detection(ball.axis, distance, sigma_bearing, sigma_range, score, distance * unsure)


def _pure(hue_deg: float) -> tuple[float, float, float]:
    """Return the fully saturated red, green, blue (0…1) of a hue."""
    h = hue_deg % 360.0 / 60.0
    r, g, b = (min(max(v, 0.0), 1.0) for v in (abs(h - 3) - 1, 2 - abs(h - 2), 2 - abs(h - 4)))
    return r, g, b


def _crossings(values: Pixels, threshold: float, rays: Pixels) -> Pixels:
    """Return the rays (3,n) of where values (h,w) cross the threshold between pixels.

    rays: (h,w,3) of the pixels. Between neighbours they change linearly but for 1e-6 rad.
    """
    w = values.shape[1]
    flat, of = values.ravel(), rays.reshape(-1, 3)
    above = values >= threshold
    across = (above[:, 1:] != above[:, :-1]).ravel().nonzero()[0]
    across += across // (w - 1)  # of the left one, in the whole patch
    down = (above[1:] != above[:-1]).ravel().nonzero()[0]
    first = np.concatenate([across, down])
    second = np.concatenate([across + 1, down + w])
    a, b = flat.take(first), flat.take(second)
    share = ((threshold - a) / (b - a))[:, None]
    start = of.take(first, axis=0)
    result: Pixels = (start + share * (of.take(second, axis=0) - start)).T
    return result


def _axes(x: float, y: float, z: float) -> Vector:
    """Return an orthonormal basis, by rows (3,3), the first of which is the unit vector x, y, z.

    Frisvad, "Building an orthonormal basis from a 3D unit vector without normalization", 2012.
    """
    # About the pole that is farther.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array(
        [
            [x, y, z],
            [1.0 + sign * x * x * a, sign * b, -sign * x],
            [b, sign + y * y * a, -y],
        ]
    )
