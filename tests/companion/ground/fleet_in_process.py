"""A fleet, its companions and its ground station in this process, by the world's own time."""

import asyncio
import contextlib
import threading
import time

from companion.ground.server import GroundServer
from companion.ground.station import COMPONENT, Station
from companion.settings.config import load_config
from mavlink_bridge.wire.memory import MemoryEndpoint
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios.scenario import Scenario

GROUND = 254
# Simulated seconds in one: an autopilot disarms by itself ten seconds after it was armed, and on a
# busy machine a browser takes seconds to press two buttons.
_FASTEST = 4.0


class Line:
    """One end for many vehicles; those in `cut` are neither heard nor reached."""

    def __init__(self, ends):
        self.ends, self.cut = ends, set()

    def receive(self):
        for system, end in self.ends.items():
            for data in end.receive():
                if system not in self.cut:
                    yield data

    def send(self, data):
        for system, end in self.ends.items():
            if system not in self.cut:
                end.send(data)
        return True

    def close(self):
        pass


def scenario(count, **drones):
    return Scenario.model_validate(
        {
            "name": "ground",
            "drones": {"count": count, "spacing": 6.0, "heading_deg": 0.0, **drones},
            "mission": {"targets": [[3.0, 0.0, 2.0]], "time_limit": 3000.0},
            "sensing": {"neighbours": "truth", "obstacles": "map", "width": 64, "height": 64},
            "companion": {
                "mission": {"auto": False, "land": False},
                "link": {"allow": [[GROUND, COMPONENT]]},
                "fence": {"east": [-60, 60], "north": [-60, 60], "altitude_max": 10},
            },
        }
    )


class Fleet:
    """World and page, which run in a thread of their own, at most at _FASTEST.

    Simulated time is the only time: the page's server has no other clock.
    """

    def __init__(self, count, folder, **drones):
        self.now, self._turned = 0.0, time.monotonic()
        self.flight = None
        self._folder, self._scenario = folder, scenario(count, **drones)
        self._ready, self._error = threading.Event(), None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(240), "the world did not start"
        if self._error:
            raise self._error
        return self

    def __exit__(self, *_):
        self.flight.stop(15)
        self._thread.join(60)
        self._loop.close()
        if self._error:
            raise self._error

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/"

    def view(self, i):
        return self.station.drones[i]

    def _run(self):
        asyncio.set_event_loop(self._loop)
        try:
            with flight(self._scenario, self._folder, in_process=True) as self.flight:
                self._fly()
        except BaseException as error:
            self._error = error
        finally:
            self._ready.set()

    def _fly(self):
        f = self.flight
        f.write_inputs()
        f.launch()
        ends = {d.index + 1: MemoryEndpoint(d.ground.endpoint) for d in f._drones}
        self.line = Line(ends)
        drones = [load_config(self._folder / "drones" / n / "config.yaml") for n in f.names]
        self.station = Station(drones, self.line, GROUND)
        self.server = GroundServer(self.station, fetch=self.fetch, debrief=lambda: "<h1>Debriefing")
        self.port = self._listen()
        self._ready.set()
        f.run(self._progress, until_stopped=True)
        self._turn(closing=True)

    def _listen(self):
        async def listen():
            return self.server.listen("127.0.0.1", 0)

        return self._loop.run_until_complete(listen())

    async def fetch(self, names):
        return dict.fromkeys(names, "1 new")

    def _progress(self, now):
        time.sleep(max(0.0, (now - self.now) / _FASTEST - (time.monotonic() - self._turned)))
        self.now, self._turned = now, time.monotonic()
        self._turn()

    def _turn(self, closing=False):
        async def turn():
            if closing:
                for page in list(self.server.pages):
                    page.close()
            else:
                self.server.turn(self.now)
            await asyncio.sleep(0)

        self._loop.run_until_complete(turn())


@contextlib.contextmanager
def fleet(count, folder, **drones):
    with Fleet(count, folder, **drones) as f:
        yield f
