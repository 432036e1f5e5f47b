"""Bodies of drones and of birds as ellipsoids: five kinds of drones in any colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.frames import quaternion_from_euler
from sitl_sim.sensors.drones import PART_FIELDS
from sitl_sim.sensors.fisheye import Float32, Float64, rotation

KINDS = ("quad-x", "quad-h", "hexa", "ducted", "toy")
Colour = tuple[float, float, float]  # BGR 0…255


@dataclass(frozen=True)
class Body:
    """One drone's body. radius: m, centre to propeller tip. blurred: its propellers turn."""

    kind: str
    radius: float
    frame: Colour
    hull: Colour
    accent: Colour
    blurred: bool
    turn: float
    gloss: float

    def parts(self) -> Float32:
        """Return the parts (n,PART_FIELDS) as `drones.Look.parts` does."""
        makers = {
            "quad-x": _quad_x,
            "quad-h": _quad_h,
            "hexa": _hexa,
            "ducted": _ducted,
            "toy": _toy,
        }
        rows = _Rows(self)
        makers[self.kind](rows)
        return np.array(rows.rows, np.float32)


def draw(kind: str, radius: float, rng: np.random.Generator) -> Body:
    """Draw a body of a kind: its colours, and whether its propellers turn."""
    grey = float(np.exp(rng.uniform(np.log(14), np.log(235))))
    vivid = rng.random() < 0.4

    def colour(middle: float) -> Colour:
        spread = 70.0 if vivid else 7.0
        b, g, r = np.clip(middle + rng.normal(0, spread, 3), 6, 250).tolist()
        return (b, g, r)

    frame = colour(grey)
    other = float(np.clip(grey * np.exp(rng.normal(0, 0.6)), 8, 245))
    return Body(
        kind,
        radius,
        frame,
        frame if rng.random() < 0.4 else colour(other),
        colour(float(rng.uniform(15, 240))),
        bool(rng.random() < 0.75),
        float(rng.uniform(0, np.pi)),
        float(rng.uniform(0.15, 0.6)),
    )


class _Rows:
    """Collects parts; lengths are shares of the radius to the propeller tips."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.rows: list[list[float]] = []

    def part(
        self,
        axes: tuple[float, float, float],
        centre: tuple[float, float, float],
        colour: Colour,
        yaw: float = 0.0,
        pitch: float = 0.0,
        opacity: float = 1.0,
        flat: float | None = None,
    ) -> None:
        """Add one ellipsoid."""
        k = self.body.radius
        to_body: Float64 = rotation(quaternion_from_euler(0.0, pitch, yaw)).T
        scaled = np.array(axes) * k
        to_unit = np.diag(1 / scaled) @ to_body
        place = np.array(centre) * k
        shaded = self.body.gloss if flat is None else flat
        numbers = [*to_unit.ravel(), *place, scaled.max(), *colour, opacity, shaded]
        self.rows.append([float(x) for x in numbers])

    def propeller(self, x: float, y: float, z: float, length: float, colour: Colour) -> None:
        """Add a propeller: a veil where it turns, a blade where not."""
        if self.body.blurred:
            self.part((length, length, 0.03), (x, y, z), colour, opacity=0.33, flat=0.8)
            return
        yaw = self.body.turn + 3.0 * x + 5.0 * y
        self.part((length, 0.1 * length, 0.012), (x, y, z), colour, yaw=yaw)

    def arms(self, count: int, first: float, reach: float, thick: float, blade: float) -> None:
        """Add arms with motors and propellers at their ends."""
        body = self.body
        for k in range(count):
            a = first + 2 * np.pi * k / count
            x, y = reach * np.cos(a), reach * np.sin(a)
            self.part((reach / 2, thick, 0.7 * thick), (x / 2, y / 2, 0.0), body.frame, yaw=a)
            self.part((0.085, 0.085, 0.11), (x, y, 0.06), body.accent)
            self.propeller(x, y, 0.17, blade, body.accent if k % 2 else body.frame)


def _quad_x(rows: _Rows) -> None:
    body = rows.body
    rows.part((0.46, 0.2, 0.12), (0, 0, 0), body.hull)
    rows.part((0.25, 0.16, 0.11), (0, 0, 0.16), body.accent)  # battery
    rows.part((0.1, 0.1, 0.09), (0.42, 0, 0.04), (20.0, 20.0, 22.0))  # camera
    rows.arms(4, np.pi / 4, 0.68, 0.065, 0.32)


def _quad_h(rows: _Rows) -> None:
    body = rows.body
    rows.part((0.62, 0.15, 0.13), (0, 0, 0), body.hull)
    rows.part((0.2, 0.13, 0.2), (-0.1, 0, 0.12), body.accent)
    for x in (0.48, -0.48):
        rows.part((0.05, 0.5, 0.05), (x, 0, 0), body.frame)
        for y in (0.5, -0.5):
            rows.part((0.08, 0.08, 0.12), (x, y, 0.07), body.accent)
            rows.propeller(x, y, 0.18, 0.3, body.accent)
    for y in (0.22, -0.22):  # landing skids
        rows.part((0.4, 0.03, 0.03), (0, y, -0.28), body.frame)
        rows.part((0.03, 0.03, 0.15), (0.15, y, -0.15), body.frame)


def _hexa(rows: _Rows) -> None:
    body = rows.body
    rows.part((0.3, 0.3, 0.13), (0, 0, 0), body.hull)
    rows.part((0.2, 0.2, 0.12), (0, 0, 0.12), body.accent)
    rows.part((0.12, 0.12, 0.12), (0.05, 0, -0.2), (28.0, 28.0, 30.0))  # gimbal
    rows.arms(6, np.pi / 6, 0.7, 0.04, 0.29)
    for y in (0.25, -0.25):
        rows.part((0.3, 0.025, 0.025), (0, y, -0.36), body.frame)
        rows.part((0.025, 0.025, 0.18), (0, y, -0.2), body.frame)


def _ducted(rows: _Rows) -> None:
    """Return a cinewhoop: each propeller in a ring, here of twelve beads."""
    body = rows.body
    rows.part((0.45, 0.15, 0.13), (0, 0, 0.0), body.hull)
    rows.part((0.26, 0.15, 0.14), (0, 0, 0.16), body.accent)
    for x in (0.41, -0.41):
        for y in (0.41, -0.41):
            rows.propeller(x, y, 0.02, 0.34, body.accent)
            for k in range(12):
                a = np.pi * k / 6
                at = (x + 0.37 * np.cos(a), y + 0.37 * np.sin(a), 0.0)
                rows.part((0.045, 0.11, 0.13), at, body.frame, yaw=a)
            rows.part((0.09, 0.09, 0.09), (x, y, 0), body.hull)


def _toy(rows: _Rows) -> None:
    """Return a small round drone: a dome and a bumper."""
    body = rows.body
    rows.part((0.5, 0.5, 0.26), (0, 0, 0.05), body.hull)
    rows.part((0.28, 0.28, 0.14), (0, 0, 0.22), body.accent)
    rows.arms(4, np.pi / 4, 0.66, 0.09, 0.32)
    rows.part((0.05, 0.3, 0.07), (0.45, 0, 0.02), (235.0, 235.0, 235.0), flat=0.9)


def bird(rng: np.random.Generator) -> Float32:
    """Return the parts of a bird with a span of 0.3 m to 1.2 m, its wings at a random beat."""
    span = float(rng.uniform(0.15, 0.6))
    tone = float(np.exp(rng.uniform(np.log(12), np.log(235))))
    b, g, r = np.clip(tone + rng.normal(0, 10, 3), 6, 245).tolist()
    body = Body("bird", span, (b, g, r), (b, g, r), (b, g, r), False, 0.0, 0.4)
    rows = _Rows(body)
    rows.part((0.42, 0.13, 0.12), (0, 0, 0), body.frame)
    rows.part((0.12, 0.09, 0.09), (0.42, 0, 0.05), body.frame)
    rows.part((0.2, 0.12, 0.02), (-0.5, 0, 0), body.frame)
    beat = float(rng.uniform(-0.9, 0.9))
    for side in (1, -1):
        # A wing along y, raised or lowered by the beat: an ellipsoid turned about x, y first.
        y, z = 0.5 * np.cos(beat), 0.5 * np.sin(beat)
        rows.part((0.5, 0.17, 0.025), (0, side * y, z), body.frame, side * np.pi / 2, -beat)
    return np.array(rows.rows, np.float32)


def leaf(rng: np.random.Generator) -> Float32:
    """Return the parts of a falling leaf."""
    b, g, r = (float(rng.uniform(20, 90)), float(rng.uniform(50, 160)), float(rng.uniform(70, 200)))
    size = float(rng.uniform(0.015, 0.05))
    rows = _Rows(Body("leaf", size, (b, g, r), (b, g, r), (b, g, r), False, 0.0, 0.4))
    rows.part((1.0, 0.55, 0.06), (0, 0, 0), (b, g, r), float(rng.uniform(0, 3)), 0.4)
    return np.array(rows.rows, np.float32)


def stack(each: list[Float32]) -> Float32:
    """Return parts (k, n, PART_FIELDS), padded with parts that no ray can hit."""
    n = max(len(parts) for parts in each)
    result = np.zeros((len(each), n, PART_FIELDS), np.float32)
    for row, parts in zip(result, each, strict=True):
        row[: len(parts)] = parts
        row[len(parts) :, :9] = np.eye(3, dtype=np.float32).ravel() * 1e6
    return result
