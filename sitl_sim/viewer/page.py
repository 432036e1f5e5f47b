"""The page: scene, time slider, camera that follows a drone, one drone's picture and state."""

from __future__ import annotations

import html
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import viser

from mavlink_bridge.shared.frames import euler_from_quaternion
from sitl_sim.figures.belief import Belief
from sitl_sim.figures.camera_pictures import Pictures
from sitl_sim.figures.events import Event
from sitl_sim.viewer.scene import Scene
from sitl_sim.viewer.sources import Moment, Source

_RATE = 20.0  # Hz, of the scene
_PICTURE_PERIOD = 0.25  # s
_STEP = 0.1  # s
_SPEEDS = ("0.25", "0.5", "1", "2", "4")
_NO_DRONE, _NO_EVENT = "no drone", "go to …"


class Page:
    """A web server with one flight on it; every browser that connects sees the same moment."""

    def __init__(
        self, source: Source, host: str = "127.0.0.1", port: int = 8080, time: float | None = None
    ) -> None:
        """Serve; time: shown first [s], else when the first drone is in the air."""
        self._source = source
        self.server = viser.ViserServer(host, port, label=source.scenario.name, verbose=False)
        self.scene = Scene(self.server, source.scenario, source.world, source.names)
        self._pictures = Pictures(source.scenario, source.world)
        self._picture_time = -np.inf
        self._shown: tuple[float, str] | None = None
        self._stop = threading.Event()
        self._lock = threading.RLock()
        self._controls()
        self.server.on_client_connect(self._on_connect)
        self._seek(self._in_the_air() if time is None else time)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def run(self) -> None:
        """Keep the page moving until `close`."""
        last = time.monotonic()
        while not self._stop.wait(1 / _RATE):
            now = time.monotonic()
            if self._source.live:
                self._show_live()
            elif self.play.value:
                self._advance((now - last) * float(self.speed.value))
            last = now

    def start(self) -> None:
        """Run in the background."""
        threading.Thread(target=self.run, daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self._stop.set()
        self.server.stop()

    def show(self, moment: float) -> None:
        """Draw the flight at a time [s]."""
        with self._lock:  # browsers call from other threads
            now = self._source.moment(moment)
            beliefs = [self._source.belief(i, now.time) for i in range(len(self._source.names))]
            with self.server.atomic():
                self.scene.show(now, beliefs, self._chosen)
                self._follow(now)
            self._show_drone(now, beliefs)

    @property
    def _chosen(self) -> int:
        """Index of the drone whose picture, state and tracks are shown."""
        return self._source.names.index(self.camera.value)

    # --- parts ---------------------------------------------------------------------------

    def _controls(self) -> None:
        gui, names, replay = self.server.gui, tuple(self._source.names), not self._source.live
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        end = max(self._source.duration, _STEP)
        happened = self._source.events()
        marks = tuple({round(e.time, 1): "" for e in happened if 0 < e.time < end}.items())
        self.slider = gui.add_slider(
            "time [s]", 0.0, end, _STEP, 0.0, marks=marks or None, disabled=not replay
        )
        self._times = {_line(e): e.time for e in happened}
        self.event = gui.add_dropdown("event", (_NO_EVENT, *self._times), visible=replay)
        self.play = gui.add_checkbox("play", False, visible=replay)
        self.speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1", visible=replay)
        self.follow = gui.add_dropdown("follow", (_NO_DRONE, *names))
        self.camera = gui.add_dropdown("camera of", names)
        for layer in self.scene.layers:
            self._toggle(layer)
        if replay:
            gui.add_html(_link())
        s = self._source.scenario.sensing
        blank = np.zeros((s.height, s.width, 3), np.uint8)
        self.picture = gui.add_image(blank, label="camera", format="jpeg")
        self.state = gui.add_markdown("")
        self.slider.on_update(self._on_seek)
        self.event.on_update(self._on_event)
        self.camera.on_update(lambda _: self._redraw())
        self.follow.on_update(lambda _: self._redraw())

    def _toggle(self, layer: str) -> None:
        box = self.server.gui.add_checkbox(layer, True)

        def switch(_: object) -> None:
            self.scene.layers[layer] = box.value
            self._redraw()

        box.on_update(switch)

    def _on_seek(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        """Show the time that a person moved the slider to; the page's own moves have no client."""
        if event.client is not None:
            self.show(event.target.value)

    def _on_event(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        """Go to the event that a person chose."""
        if event.client is not None and event.target.value in self._times:
            self._seek(self._times[event.target.value])

    def _seek(self, moment: float) -> None:
        moment = min(max(moment, 0.0), self._source.duration)
        _set(self.slider, moment)
        self.show(moment)

    def _in_the_air(self) -> float:
        """Return the first time [s] at which a drone flies; 0 where none does."""
        started = [e.time for e in self._source.events() if e.kind == "phase" and e.text == "fly"]
        return min(started, default=0.0)

    def _redraw(self) -> None:
        self.show(self.slider.value)

    def _on_connect(self, client: viser.ClientHandle) -> None:
        """Look at the drones from behind, from so far that all are in the picture."""
        now = self._source.moment(self.slider.value)
        middle = now.p.mean(axis=0)
        far = 5.0 + 1.5 * float(np.linalg.norm(now.p - middle, axis=1).max())
        yaws = np.array([euler_from_quaternion(q)[2] for q in now.q])
        behind = np.array([-np.cos(yaws).mean(), -np.sin(yaws).mean(), 0.7])
        behind /= np.linalg.norm(behind)
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = middle + far * behind
        client.camera.look_at = middle

    def _advance(self, seconds: float) -> None:
        moment = self.slider.value + seconds
        if moment >= self._source.duration:
            moment = self._source.duration
            _set(self.play, False)
        _set(self.slider, moment)
        self.show(moment)

    def _show_live(self) -> None:
        self.slider.max = max(self._source.duration, 0.1)
        _set(self.slider, self._source.duration)
        self.show(self._source.duration)

    def _follow(self, now: Moment) -> None:
        """Put every browser's camera behind the drone that is followed."""
        if self.follow.value == _NO_DRONE:
            return
        p = now.p[self._source.names.index(self.follow.value)]
        _, _, yaw = euler_from_quaternion(now.q[self._source.names.index(self.follow.value)])
        behind = np.array([-3.5 * np.cos(yaw), -3.5 * np.sin(yaw), 1.5])
        for client in self.server.get_clients().values():
            client.camera.position = p + behind
            client.camera.look_at = p

    def _show_drone(self, now: Moment, beliefs: list[Belief | None]) -> None:
        """Show picture and state of the chosen drone; the picture a few times a second."""
        i = self._chosen
        self.state.content = _describe(beliefs[i])
        wall, wanted = time.monotonic(), (now.time, self.camera.value)
        if wanted != self._shown and wall - self._picture_time >= _PICTURE_PERIOD:
            self.picture.image = self._pictures.take(now.p, now.q, i, beliefs[i])[..., ::-1]
            self._picture_time, self._shown = wall, wanted


def _set(handle: viser.GuiInputHandle[Any], value: object) -> None:
    """Change a control."""
    handle.value = value  # type: ignore[misc]  # viser hides its setter from type checkers


def _link() -> str:
    """Return HTML that runs `link.js`; a page runs no script that comes later, but a handler."""
    script = Path(__file__).with_name("link.js").read_text("utf-8")
    return f'<img hidden src="data:," onerror="{html.escape(f"(() => {{{script}}})()")}">'


def _line(event: Event) -> str:
    return f"{event.time:.1f} s  {event.drone}: {event.text}"


def _describe(belief: Belief | None) -> str:
    """Return a drone's state as a few lines of Markdown."""
    if belief is None:
        return "no log yet"
    r = belief.record
    command, goal = r.get("command", {}), r.get("goal", {})
    return "\n\n".join(
        [
            f"**{r['phase']}**, target {goal.get('index', 0) + 1}, "
            f"guard: {command.get('reason', '–')}",
            f"{len(r['detections'])} detections, {len(r['tracks'])} tracks, "
            f"{len(belief.critical)} critical",
            f"tick {r['stages_ms'].get('tick', 0.0):.1f} ms, "
            f"solve {r.get('solver', {}).get('solve_ms', 0.0):.1f} ms",
        ]
    )
