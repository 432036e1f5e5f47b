"""Meshes and textures for `panda_frames`: tubes, balls, grids and mottled colours in panda3d."""

from __future__ import annotations

import cv2
import numpy as np
from panda3d.core import (
    Geom,
    GeomNode,
    GeomTriangles,
    GeomVertexData,
    GeomVertexFormat,
    Texture,
)


def mesh(vertices: np.ndarray, normals: np.ndarray, uv: np.ndarray, quads: np.ndarray) -> GeomNode:
    """Return a node of quadrilaterals (n,4) over vertices (m,3)."""
    data = GeomVertexData("mesh", GeomVertexFormat.getV3n3t2(), Geom.UHStatic)
    data.setNumRows(len(vertices))
    view = memoryview(data.modifyArray(0)).cast("B").cast("f")
    view[:] = memoryview(
        np.hstack([vertices, normals, uv]).astype(np.float32).ravel().tobytes()
    ).cast("f")
    triangles = GeomTriangles(Geom.UHStatic)
    for a, b, c, d in quads.tolist():
        triangles.addVertices(a, b, c)
        triangles.addVertices(a, c, d)
    geom = Geom(data)
    geom.addPrimitive(triangles)
    node = GeomNode("mesh")
    node.addGeom(geom)
    return node


def grid(rows: int, columns: int) -> np.ndarray:
    """Return the quadrilaterals between rows and columns of vertices."""
    a = np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)
    return np.stack([a, a + 1, a + columns + 1, a + columns], axis=-1).reshape(-1, 4)


def tube(a: np.ndarray, b: np.ndarray, radius: float, top: float = 1.0) -> GeomNode:
    """Return a tube from a to b (3,) m; top: its upper radius over the lower."""
    axis = (b - a) / np.linalg.norm(b - a)
    x = np.cross(axis, [0.3, 1.0, 0.2])
    x /= np.linalg.norm(x)
    y, turn = np.cross(axis, x), np.linspace(0, 2 * np.pi, 21)
    ring = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
    vertices = np.vstack([a + radius * ring, b + top * radius * ring])
    long = float(np.linalg.norm(b - a))
    across = turn / (2 * np.pi) * max(round(4 * radius), 1)
    uv = np.vstack([np.c_[across, 0 * turn], np.c_[across, 0 * turn + long / 2]])
    return mesh(vertices, np.vstack([ring, ring]), uv, grid(2, 21))


def ball(centre: np.ndarray, axes: np.ndarray, rough: float, rng: np.random.Generator) -> GeomNode:
    """Return an ellipsoid, its surface moved by `rough` of its radius."""
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, np.pi / 2, 13))
    n = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1)
    out = 1 + rough * rng.standard_normal(turn.shape)
    out[:, -1] = out[:, 0]
    uv = np.stack([turn, rise], axis=-1)
    flat = (n * out[..., None]).reshape(-1, 3)
    return mesh(centre + flat * axes, flat, uv.reshape(-1, 2), grid(13, 25))


def texture(
    rng: np.random.Generator, colour: np.ndarray, contrast: float, stretch: float
) -> Texture:
    """Return a mottled texture around a BGR colour."""
    tone = np.zeros((256, 256), np.float32)
    for n in (8, 24, 64, 160):
        coarse = rng.standard_normal((n, max(int(n * stretch), 2))).astype(np.float32)
        tone += cv2.resize(coarse, (256, 256), interpolation=cv2.INTER_CUBIC) / np.sqrt(n / 8)
    tone = cv2.resize(tone, (128, 128), interpolation=cv2.INTER_AREA)
    tone = np.hstack([tone, tone[:, ::-1]])
    tone = np.vstack([tone, tone[::-1]])  # no seams where it repeats
    hue = 1 + 0.03 * rng.standard_normal(3) * tone[..., None] / tone.std()
    shown = colour * hue * (1 + contrast * tone[..., None] / tone.std())
    made = Texture()
    made.setup2dTexture(256, 256, Texture.T_unsigned_byte, Texture.F_rgb)
    made.setRamImage(np.clip(shown, 4, 250).astype(np.uint8).tobytes())
    made.setWrapU(Texture.WM_repeat)
    made.setWrapV(Texture.WM_repeat)
    return made
