"""A flight as a film: left what is true, right one drone's camera and what it knows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.figures.belief import Belief, Beliefs
from sitl_sim.figures.bird_view import BACKGROUND, RED, WHITE, BirdView, Image, write
from sitl_sim.figures.camera_pictures import Pictures
from sitl_sim.figures.curves import colours, rgb
from sitl_sim.figures.events import Event, events
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.recording.run_folder import Run, own_frames

CODECS = {".mp4": "mp4v", ".webm": "VP80"}
"""Kinds of video by their suffix; `.webp` is an animated picture."""
SIZE = (1280, 720)
_RIGHT = 480  # px of the right column
_TRAIL, _TRAIL_STEP = 6.0, 0.1  # s
_AROUND = 9.0  # m that the map of the drone shows to each side
_SEEN = 0.3  # s: a track that was not seen for longer is remembered
_CAPTION = 3.0  # s that an event stays
_KINDS = {"target", "collision", "guard", "fault", "silence"}  # that are told
_EARTH, _GREY = (85, 125, 150), (150, 150, 150)


class Film:
    """Draws the moments of a flight."""

    def __init__(self, run: Run, drone: int) -> None:
        self._run, self._drone = run, drone
        self._beliefs, self._events = Beliefs(run), [e for e in events(run) if e.kind in _KINDS]
        self._pictures = Pictures(run.scenario, run.world)
        self._colours = np.array([rgb(c)[::-1] for c in colours(len(run.names))])
        self._frame = own_frames(run.scenario, run.world)[drone]
        self._p, self._q = (run.truth[k].astype(float) for k in ("position", "attitude"))
        flown = self._p[:: max(len(self._p) // 500, 1)].reshape(-1, 3)
        self._bird = BirdView(run.world, flown, (SIZE[0] - _RIGHT, SIZE[1]))

    def at(self, time: float) -> Image:
        """Return the picture (H,W,3) BGR of a time [s]."""
        k = self._index(time)
        belief = self._beliefs.at(self._drone, time)
        image = np.full((SIZE[1], SIZE[0], 3), BACKGROUND, np.uint8)
        image[:, : SIZE[0] - _RIGHT] = self._truth(time, k)
        camera = self._camera(k, belief)
        top = 34
        image[top : top + len(camera), SIZE[0] - _RIGHT :] = camera
        below = top + len(camera) + 34
        image[below:, SIZE[0] - _RIGHT :] = self._knowledge(k, belief, SIZE[1] - below)
        name = self._run.names[self._drone]
        left = SIZE[0] - _RIGHT + 4
        write(image, f"{name}: its camera", (left, 23), 0.55)
        write(image, "what it knows, from above", (left, below - 11), 0.55)
        write(image, f"{time:.1f} s", (SIZE[0] - 90, below - 11), 0.55)
        return image

    def _index(self, time: float) -> int:
        return min(int(np.searchsorted(self._run.truth["t"], time)), len(self._p) - 1)

    def _truth(self, time: float, k: int) -> Image:
        """Draw the swarm, the title, and what has just happened."""
        trail = [self._index(t) for t in time - np.arange(_TRAIL, -1e-9, -_TRAIL_STEP)]
        radius = self._run.world["drone_radius"]
        paths = self._p[trail].swapaxes(0, 1)
        image = self._bird.draw(self._p[k], paths, self._colours, radius, self._drone)
        s = self._run.scenario
        write(image, f"{s.name}, seed {s.seed}", (16, 30), 0.75)
        recent = [e for e in self._events if time - _CAPTION <= e.time <= time]
        for line, event in enumerate(reversed(recent[-4:])):
            self._tell(image, event, line)
        return image

    def _tell(self, image: Image, event: Event, line: int) -> None:
        """Write an event, and ring the place of a collision."""
        crash = event.kind == "collision"
        text = f"{event.time:.1f} s  {event.drone}: {event.text}"
        write(image, text, (16, SIZE[1] - 16 - 24 * line), 0.55, RED if crash else WHITE)
        if crash:
            place = self._p[self._index(event.time), self._run.names.index(event.drone)]
            self._bird.mark(image, place, RED)

    def _camera(self, k: int, belief: Belief | None) -> Image:
        scale = _RIGHT / self._run.scenario.sensing.width
        made: Image = self._pictures.take(self._p[k], self._q[k], self._drone, belief, scale)
        return made[:, :_RIGHT]

    def _knowledge(self, k: int, belief: Belief | None, height: int) -> Image:
        """Draw field of view, obstacles, neighbours and plan as believed; thin rings: the truth."""
        image = np.full((height, _RIGHT, 3), BACKGROUND, np.uint8)
        if belief is None or "own" not in belief.record:
            write(image, "nothing yet", (12, 24), 0.5, _GREY)
            return image
        scale = _RIGHT / 2 / _AROUND
        own = self._frame.points(belief.record["own"]["p"])
        middle = np.array([_RIGHT / 2, height / 2])

        def px(p: Any) -> tuple[int, int]:
            u = middle + scale * (np.asarray(p, float)[:2] - own[:2]) * [1, -1]
            return round(float(u[0])), round(float(u[1]))

        _, _, yaw = euler_from_quaternion(self._q[k, self._drone])
        half = self._run.scenario.sensing.fov_deg / 2
        start, reach = -np.degrees(yaw) - half, round(8.0 * scale)
        view = tuple(int(0.35 * c + 0.65 * b) for c, b in
                     zip(self._colours[self._drone], BACKGROUND, strict=True))  # fmt: skip
        cv2.ellipse(image, px(own), (reach, reach), 0, start, start + 2 * half, view, -1)
        for x, y, radius, *_ in belief.record["cylinders"]:
            at = px(self._frame.points([x, y, 0.0]))
            cv2.circle(image, at, max(round(radius * scale), 2), _EARTH, -1, cv2.LINE_AA)
        for c in self._run.world["cylinders"]:
            size = round(c["radius"] * scale)
            cv2.circle(image, px([c["x"], c["y"]]), size, _GREY, 1, cv2.LINE_AA)
        for b in self._run.world["boxes"]:
            cv2.rectangle(image, px(b["min"]), px(b["max"]), _GREY, 1, cv2.LINE_AA)
        for i, p in enumerate(self._p[k]):
            if i != self._drone:
                cv2.circle(image, px(p), 8, _GREY, 1, cv2.LINE_AA)
        self._neighbours(image, belief, px, own)
        if len(belief.plan):
            plan = np.array([px(p) for p in belief.plan], np.int32)
            cv2.polylines(image, [plan], False, WHITE, 2, cv2.LINE_AA)
        colour = tuple(map(int, self._colours[self._drone]))
        cv2.circle(image, px(own), 6, colour, -1, cv2.LINE_AA)
        return image

    def _neighbours(
        self, image: Image, belief: Belief, px: Callable[[Any], tuple[int, int]], own: Vector
    ) -> None:
        """Draw tracks: red critical, white others; a ring is remembered."""
        critical = [t.position for t in belief.critical]
        for p in critical:
            cv2.line(image, px(own), px(p), RED, 1, cv2.LINE_AA)
        for p, track in zip(belief.tracks, belief.record["tracks"], strict=True):
            threat = any(np.allclose(p, c) for c in critical)
            fill = -1 if track["unseen"] <= _SEEN else 2
            cv2.circle(image, px(p), 5, RED if threat else WHITE, fill, cv2.LINE_AA)


def span(run: Run) -> tuple[float, float]:
    """Return the first and last time [s] at which a drone is in the air."""
    t = run.truth["t"]
    up = np.flatnonzero((run.truth["position"][..., 2] > AIRBORNE).any(axis=1))
    return (float(t[up[0]]), float(t[up[-1]])) if len(up) else (float(t[0]), float(t[-1]))


def write_film(frames: Iterator[Image], path: Path, rate: float, width: int) -> Path:
    """Write pictures as a video of `rate` Hz and `width` px; return its path.

    Raises:
        SettingsError: the place cannot be written, or is of an unknown kind.
    """
    size = (width, round(width * SIZE[1] / SIZE[0]) // 2 * 2)
    scaled = (cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames)
    if path.suffix == ".webp":
        film = cv2.Animation()
        film.frames = list(scaled)
        film.durations = [round(1000 / rate)] * len(film.frames)
        if not cv2.imwriteanimation(str(path), film, [cv2.IMWRITE_WEBP_QUALITY, 60]):
            raise SettingsError([f"--out {path}: cannot be written"])
        return path
    if path.suffix not in CODECS:
        raise SettingsError([f"--out {path}: must end in {', '.join(CODECS)} or .webp"])
    code = cv2.VideoWriter.fourcc(*CODECS[path.suffix])
    writer = cv2.VideoWriter(str(path), code, rate, size)
    if not writer.isOpened():
        raise SettingsError([f"--out {path}: cannot be written"])
    for image in scaled:
        writer.write(image)
    writer.release()
    return path
