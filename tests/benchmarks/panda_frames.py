"""Labelled frames of a renderer that nothing here was made with: panda3d, in software.

    pip install panda3d
    python tests/benchmarks/panda_frames.py DIR [--seed S] [--count N]
    companion bench perception --frames DIR

Panda3D draws meshes by rasterisation, without shadows; the product's own pictures are traced. Five
faces of a cube are drawn and bent into the fisheye's picture. Who is visible follows from a second
drawing in which each object has a colour of its own. The layout of the labels is that of
`companion/bench/labels.py`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import yaml
from panda3d.core import (
    AmbientLight,
    DirectionalLight,
    GeomNode,
    LMatrix4,
    NodePath,
    PerspectiveLens,
    Texture,
    TransparencyAttrib,
    loadPrcFileData,
)
from panda_meshes import ball, grid, mesh, texture, tube

loadPrcFileData("", "load-display p3tinydisplay\naudio-library-name null\nnotify-level error")

WIDTH, HEIGHT, FOV = 640, 400, np.radians(160.0)
FACE = 800  # px of a side of the cube
REACH, RADIUS = 14.0, 0.2  # m: of obstacles; of drones
# Each face's right, forward, up in the camera's frame (x right, y down, z forward).
FACES = np.array(
    [
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
        [[0, 0, 1], [-1, 0, 0], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ],
    float,
)


def rays() -> np.ndarray:
    """Return the directions (HEIGHT,WIDTH,3) of an equidistant lens's pixels, camera frame."""
    f = WIDTH / FOV
    x, y = np.meshgrid(
        (np.arange(WIDTH) - (WIDTH - 1) / 2) / f, (np.arange(HEIGHT) - (HEIGHT - 1) / 2) / f
    )
    theta = np.hypot(x, y)
    scale = np.sinc(theta / np.pi)
    return np.stack([scale * x, scale * y, np.cos(theta)], axis=2)


def pixels(directions: np.ndarray) -> np.ndarray:
    """Return the pixels (n,2) of directions (n,3), camera frame."""
    rho = np.hypot(directions[:, 0], directions[:, 1])
    scale = WIDTH / FOV * np.arctan2(rho, directions[:, 2]) / np.maximum(rho, 1e-9)
    return scale[:, None] * directions[:, :2] + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]


class Studio:
    """Draws two scenes, as they look and by the objects' numbers, from one camera."""

    def __init__(self) -> None:
        from direct.showbase.ShowBase import ShowBase

        loadPrcFileData("", f"win-size {FACE} {FACE}")
        self.base = ShowBase(windowType="offscreen")
        lens = PerspectiveLens()
        lens.setFov(90)
        lens.setNearFar(0.05, 300)
        self.base.cam.node().setLens(lens)
        d = rays() @ np.swapaxes(FACES, 1, 2)[:, None]  # faces, rows, columns, (right, forward, up)
        face = d[..., 1].argmax(axis=0)
        r, f, u = np.take_along_axis(d, face[None, ..., None], axis=0)[0].transpose(2, 0, 1)
        u_face, v_face = (np.clip(FACE / 2 * (1 + x / f) - 0.5, 0, FACE - 1) for x in (r, -u))
        self.u, self.v = u_face.astype(np.float32), (v_face + FACE * face).astype(np.float32)

    def picture(self, root: NodePath, p: np.ndarray, r_wc: np.ndarray, smooth: bool) -> np.ndarray:
        """Return the fisheye's picture (HEIGHT,WIDTH,3) BGR of a scene."""
        self.base.cam.node().setScene(root)
        drawn = []
        for axes in FACES @ r_wc.T:
            rows = np.eye(4)
            rows[:3, :3], rows[3, :3] = axes, p
            self.base.cam.setMat(self.base.render, LMatrix4(*rows.ravel()))
            self.base.graphicsEngine.renderFrame()
            texture = self.base.win.getScreenshot()
            data = np.frombuffer(texture.getRamImageAs("BGR"), np.uint8)
            drawn.append(data.reshape(FACE, FACE, 3)[::-1])
        sheet = np.vstack(drawn)
        if smooth:
            sheet = cv2.blur(sheet, (3, 3))
        how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        return cv2.remap(sheet, self.u, self.v, how, borderMode=cv2.BORDER_REPLICATE)


class Scene:
    """One world around the camera at (0, 0, p[2]): as it looks, and by numbers."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.seen, self.numbers = rng, NodePath("seen"), NodePath("numbers")
        self.count = 0
        self.slope = rng.uniform(-0.17, 0.17, 2) if rng.random() < 0.35 else np.zeros(2)
        self.p = np.array([0.0, 0.0, rng.uniform(0.8, 4.0)])
        self.trunks: list[tuple[int, float, float, float]] = []  # number, x, y, radius
        self._lights()
        self._ground()
        self._obstacles()

    def add(self, node: GeomNode, look: Texture | np.ndarray, lit: bool = True) -> int:
        """Put a node into both scenes, with a texture or a BGR colour; return its number."""
        self.count += 1
        self.again(node, look, lit)
        return self.count

    def again(self, node: GeomNode, look: Texture | np.ndarray, lit: bool = True) -> None:
        """Add to the object that was added last."""
        seen = self.seen.attachNewNode(node)
        seen.setTwoSided(True)
        if isinstance(look, Texture):
            seen.setTexture(look)
        else:
            b, g, r, *a = (look / 255).tolist()
            seen.setColor(r, g, b, *a)
            if a:
                seen.setTransparency(TransparencyAttrib.MAlpha)
        if not lit:
            seen.setLightOff(1)
        number = self.numbers.attachNewNode(node.makeCopy())
        number.setTwoSided(True)
        n = self.count
        number.setColor(*((16 * (n >> k & 15) + 8) / 255 for k in (8, 4, 0)), 1)
        number.setTextureOff(1)
        number.setLightOff(1)

    def height(self, x: float, y: float) -> float:
        """Return the ground's height [m]."""
        return float(self.slope @ [x, y])

    def _lights(self) -> None:
        rng = self.rng
        for light, strength in ((AmbientLight("a"), 0.45), (DirectionalLight("d"), 0.75)):
            light.setColor((*(strength * np.exp(rng.normal(0, 0.12, 3))).tolist(), 1))
            path = self.seen.attachNewNode(light)
            path.setHpr(float(rng.uniform(-180, 180)), float(rng.uniform(-70, -20)), 0)
            self.seen.setLight(path)

    def _ground(self) -> None:
        rng = self.rng
        sky = np.clip(rng.uniform(120, 240) + rng.normal(0, 25, 3), 60, 250)
        self.add(
            ball(np.zeros(3), np.full(3, 200.0), 0.0, rng), texture(rng, sky, 0.04, 1.0), False
        )
        x, y = np.meshgrid(np.linspace(-60, 60, 61), np.linspace(-60, 60, 61))
        z = self.slope[0] * x + self.slope[1] * y
        up = np.tile([0.0, 0.0, 1.0], (x.size, 1))
        tone = np.clip(rng.uniform(50, 200) + rng.normal(0, 30, 3), 20, 240)
        look = texture(rng, tone, float(rng.uniform(0.05, 0.25)), 1.0)
        vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        self.add(mesh(vertices, up, vertices[:, :2] / 3, grid(61, 61)), look)

    def _obstacles(self) -> None:
        rng = self.rng
        barks = [
            texture(rng, np.clip(rng.uniform(40, 170) + rng.normal(0, 18, 3), 15, 230), 0.2, 0.2)
            for _ in range(2)
        ]
        for _ in range(int(rng.integers(6, 22))):
            x, y = rng.uniform(-REACH, REACH, 2)
            radius = float(np.exp(rng.uniform(np.log(0.1), np.log(1.2))))
            if np.hypot(x, y) < radius + 0.6:
                continue
            foot = np.array([x, y, self.height(x, y) - 0.3])
            lean = rng.normal(0, 0.12, 2) if rng.random() < 0.3 else np.zeros(2)
            tall = float(rng.uniform(5, 11))
            top = foot + tall * np.array([*lean, 1.0])
            n = self.add(tube(foot, top, radius), barks[rng.integers(2)])
            at = foot + (top - foot) * (self.p[2] - foot[2]) / tall
            if at[2] < top[2]:
                self.trunks.append((n, float(at[0]), float(at[1]), radius))
        leaves = texture(rng, np.array([50.0, 100, 70]) * rng.uniform(0.6, 1.5), 0.35, 1.0)
        for _ in range(int(rng.integers(0, 6))):
            x, y = rng.uniform(-REACH, REACH, 2)
            r = float(rng.uniform(0.4, 1.1))
            if np.hypot(x, y) < r + 0.6:
                continue
            centre = np.array([x, y, self.height(x, y) + 0.7 * r])
            n = self.add(ball(centre, np.full(3, r), 0.06, rng), leaves)
            left = r * r - (self.p[2] - centre[2]) ** 2
            if left > 0.3 * r * r:
                self.trunks.append((n, float(x), float(y), float(np.sqrt(left))))

    def drone(self, place: np.ndarray, turn: np.ndarray) -> int:
        """Add a drone of RADIUS at place (3,), turned by (3,3); return its number."""
        rng, k = self.rng, RADIUS
        tone = float(np.exp(rng.uniform(np.log(15), np.log(230))))
        hull = np.clip(tone + rng.normal(0, rng.choice([5.0, 60.0]), 3), 5, 250)
        dark, veil = (
            0.5 * hull,
            np.append(np.clip(hull * 0.8, 5, 250), 255.0 * rng.uniform(0.2, 0.5)),
        )
        arms = int(rng.choice([4, 4, 4, 6]))

        def at(*xyz: float) -> np.ndarray:
            return place + turn @ (k * np.array(xyz))

        def body(centre: tuple[float, float, float], axes: tuple[float, float, float]) -> GeomNode:
            made = ball(np.zeros(3), k * np.array(axes), 0.0, rng)
            rows = np.eye(4)
            rows[:3, :3], rows[3, :3] = turn.T, at(*centre)
            path = NodePath(made)
            path.setMat(LMatrix4(*rows.ravel()))
            path.flattenLight()
            return path.node()

        n = self.add(body((0, 0, 0), (0.42, 0.2, 0.12)), hull)
        self.again(body((0.3, 0, -0.14), (0.1, 0.1, 0.1)), dark)
        for a in 2 * np.pi * (np.arange(arms) + 0.5) / arms:
            x, y = 0.68 * np.cos(a), 0.68 * np.sin(a)
            self.again(tube(at(0, 0, 0), at(x, y, 0.02), 0.05 * k, 0.7), hull)
            self.again(tube(at(x, y, -0.05), at(x, y, 0.13), 0.08 * k), dark)
            self.again(body((x, y, 0.15), (0.32, 0.32, 0.015)), veil)
        for y in (-0.22, 0.22):
            self.again(tube(at(-0.3, y, -0.3), at(0.3, y, -0.3), 0.03 * k), dark)
        return n


def number_of(image: np.ndarray) -> np.ndarray:
    """Return the objects' numbers (h,w) in a picture by numbers, (h,w,3) BGR."""
    n = image.astype(int) // 16
    return n[..., 2] * 256 + n[..., 1] * 16 + n[..., 0]


def attitude(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Return the quaternion (4,) body → world of yaw, then pitch, then roll."""
    cy, sy, cp, sp = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    cr, sr = np.cos(roll / 2), np.sin(roll / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def rotation(q: np.ndarray) -> np.ndarray:
    """Return the matrix (3,3) of a quaternion (4,)."""
    w, x, y, z = q
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def frame(studio: Studio, rng: np.random.Generator) -> tuple[np.ndarray, dict]:
    """Return one picture and its labels."""
    scene = Scene(rng)
    q = attitude(rng.uniform(-np.pi, np.pi), *np.radians(rng.uniform(-15, 15, 2)))
    r_wc = rotation(q) @ np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    everything = rays()
    drones = []
    for _ in range(int(rng.integers(0, 6))):
        ray = everything[rng.integers(60, HEIGHT - 60), rng.integers(30, WIDTH - 30)]
        away = float(rng.uniform(0.8, 10.0))
        place = scene.p + away * r_wc @ ray
        far = all(np.linalg.norm(place - d[1]) > 0.6 for d in drones)
        if far and place[2] > scene.height(*place[:2]) + 0.3:
            turn = rotation(attitude(rng.uniform(-3, 3), *rng.uniform(-0.4, 0.4, 2)))
            drones.append((scene.drone(place, turn), place, ray, away))
    image = studio.picture(scene.seen, scene.p, r_wc, True)
    shown = number_of(studio.picture(scene.numbers, scene.p, r_wc, False))
    labels = []
    for n, _, ray, away in drones:
        only = alone(studio, scene, n, r_wc) == n
        share = np.count_nonzero(only & (shown == n)) / max(np.count_nonzero(only), 1)
        ray_and_range = {"direction": ray.tolist(), "range": away, "radius": RADIUS}
        labels.append({**ray_and_range, "visible": float(share)})
    trunks = [t for each in scene.trunks if (t := trunk(scene, shown, each, r_wc)) is not None]
    return developed(image, rng), {
        "altitude": float(scene.p[2]),
        "q": q.tolist(),
        "drones": labels,
        "trunks": trunks,
        "conditions": "panda3d",
        "look": "panda3d",
    }


def alone(studio: Studio, scene: Scene, n: int, r_wc: np.ndarray) -> np.ndarray:
    """Return the numbers (h,w) in the picture of one object without all others."""
    for child in scene.numbers.getChildren():
        r, g, b = (round(c * 255) // 16 for c in list(child.getColor())[:3])
        if r * 256 + g * 16 + b == n:
            child.show()
        else:
            child.hide()
    return number_of(studio.picture(scene.numbers, scene.p, r_wc, False))


def trunk(
    scene: Scene, shown: np.ndarray, each: tuple[int, float, float, float], r_wc: np.ndarray
) -> dict | None:
    """Return the label of an obstacle: as it is at the camera's height; None where too near."""
    n, x, y, radius = each
    d, middle = float(np.hypot(x, y)), np.arctan2(y, x)
    if not radius < d < 16.0:
        return None
    delta = np.arcsin(radius / d) * np.linspace(-0.95, 0.95, 41)
    level = np.stack([np.cos(middle + delta), np.sin(middle + delta), 0 * delta], axis=1)
    at = np.round(pixels(level @ r_wc)).astype(int)
    inside = ((at >= 0) & (at < [WIDTH, HEIGHT])).all(axis=1)
    hits = np.zeros(len(at), bool)
    hits[inside] = shown[at[inside, 1], at[inside, 0]] == n
    direction = np.array([np.cos(middle), np.sin(middle), 0.0]) @ r_wc
    return {
        "direction": direction.tolist(),
        "distance": d,
        "radius": radius,
        "visible": float(hits.mean()),
    }


def developed(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the picture as a camera would give it: exposure, white balance, blur and noise."""
    gain = np.exp(rng.normal(0, 0.1, 3)) * 110 / max(float(image.mean()), 20.0)
    soft = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.3, 0.8)))
    noisy = soft * gain + rng.normal(0, rng.uniform(1, 4), image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def main() -> None:
    """Write the frames."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    f = float(WIDTH / FOV)
    lens = {"width": WIDTH, "height": HEIGHT, "fx": f, "fy": f}
    lens |= {"cx": (WIDTH - 1) / 2, "cy": (HEIGHT - 1) / 2} | {f"k{n}": 0.0 for n in (1, 2, 3, 4)}
    (options.folder / "camera.yaml").write_text(yaml.safe_dump(lens))
    studio, rows = Studio(), []
    for n in range(options.count):
        image, row = frame(studio, np.random.default_rng([options.seed, n]))
        cv2.imwrite(str(options.folder / f"{n:05d}.png"), image)
        rows.append({"file": f"{n:05d}.png", **row})
    (options.folder / "frames.json").write_text(json.dumps({"frames": rows}))


if __name__ == "__main__":
    main()
