"""The page's server: files of the package, and a WebSocket that shows the fleet and takes actions.

On this machine alone it is open; to others it demands a token. A page of another site can neither
read nor ask anything: the Host and the Origin of each request are checked.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import time
from collections.abc import Awaitable, Callable
from importlib.resources import files
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from companion.ground.station import Station

PERIOD = 0.1  # s between two states of the page
_STEP = 0.02  # s between two looks at the link
LOCAL = ("127.0.0.1", "::1", "localhost")
_COOKIE = "ground_token"
_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:"
ACTIONS = ("arm", "takeoff", "start", "hold", "resume", "goals", "return", "land")
_GOALS_MOST = 200


class BadRequest(ValueError):
    """What a page asked cannot be understood; the message says why."""


class GroundServer:
    """Serves the page of one station.

    token: demanded of every request; empty: none, and only this machine's own names are served.
    fetch: pulls the logs of the drones named, and returns what came of it, in words. debrief:
    returns the debriefing of what was pulled as an HTML page.
    """

    def __init__(
        self,
        station: Station,
        token: str = "",
        fetch: Callable[[list[str]], Awaitable[dict[str, str]]] | None = None,
        debrief: Callable[[], str] | None = None,
        advance: Callable[[float], None] = lambda now: None,
    ) -> None:
        self.station, self.token = station, token
        self.fetch, self.debrief = fetch, debrief
        self.notes: list[str] = []
        self.pages: set[Page] = set()
        self.now = self._shown_at = -1e9
        self._advance = advance
        shared = {"server": self}
        self._application = Application(
            [
                (r"/fleet", Page, shared),
                (r"/debrief", Debrief, shared),
                (r"/(|app\.js|map\.js|style\.css)", File, shared),
            ],
            websocket_max_message_size=1 << 16,
        )

    def listen(self, host: str, port: int) -> int:
        """Open the port; return it (0: any free one).

        Raises:
            OSError: the port cannot be bound.
        """
        sockets = bind_sockets(port, host)
        self._http = HTTPServer(self._application)
        self._http.add_sockets(sockets)
        return int(sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Release the port, and end the connections."""
        self._http.stop()
        await self._http.close_all_connections()

    async def run(self) -> None:
        """Follow the fleet and show it, for ever."""
        while True:
            self.turn(time.monotonic())
            await asyncio.sleep(_STEP)

    def turn(self, now: float) -> None:
        """Follow the fleet, and show it where that is due; now: s, of a clock that only grows."""
        self.now = now
        self._advance(now)
        self.station.step(now)
        if now - self._shown_at < PERIOD - _STEP / 2 or not self.pages:
            return
        self._shown_at = now
        state = self.station.snapshot(now)
        for page in list(self.pages):
            page.show(state)


class Guarded(RequestHandler):
    """Refuses requests of strangers; the token of the first request is kept in a cookie."""

    def initialize(self, server: GroundServer) -> None:
        """Take the server that the handlers share."""
        self.server = server

    def set_default_headers(self) -> None:
        """Let the page load nothing from elsewhere, and nobody keep it."""
        self.set_header("Content-Security-Policy", _POLICY)
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def prepare(self) -> None:
        """Let nobody in who must not be.

        Raises:
            HTTPError: 403, the Host is no name of this machine; 401, the token is missing or wrong.
        """
        token = self.server.token
        if not token:
            if host_of(self.request) not in LOCAL:
                raise HTTPError(403, "only by 127.0.0.1 or localhost")
            return
        given = self.get_query_argument("token", "")
        if given and hmac.compare_digest(given.encode(), token.encode()):
            self.set_cookie(_COOKIE, token, httponly=True, samesite="Strict")
            return
        kept = self.get_cookie(_COOKIE) or ""
        if not hmac.compare_digest(kept.encode(), token.encode()):
            raise HTTPError(401, "the token is missing or wrong: open the address that was printed")


def host_of(request: HTTPServerRequest) -> str:
    """Return the host that a request names, without its port."""
    host = request.host
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


class File(Guarded):
    """A file of the page."""

    def get(self, name: str) -> None:
        """Answer with the file."""
        name = name or "index.html"
        self.set_header("Content-Type", f"{_TYPES[name.rpartition('.')[2]]}; charset=utf-8")
        self.finish((files("companion.ground") / "page" / name).read_bytes())


class Debrief(Guarded):
    """The debriefing of the logs that were pulled."""

    def get(self) -> None:
        """Answer with the page."""
        if self.server.debrief is None:
            raise HTTPError(404)
        self.finish(self.server.debrief())


class Page(Guarded, WebSocketHandler):
    """One open page."""

    def open(self, *args: str, **kwargs: str) -> None:
        """Send what the page needs first."""
        self._since: dict[str, int] = {}
        self._result = 0
        self.set_nodelay(True)
        station = self.server.station
        self._send({"trails": station.trails(), "notes": self.server.notes})
        self.server.pages.add(self)

    def on_close(self) -> None:
        """Forget the page: nothing else changes."""
        self.server.pages.discard(self)

    def show(self, state: dict[str, Any]) -> None:
        """Send the state, and what is new of words and results."""
        if self.ws_connection is None or self.ws_connection.is_closing():
            self.on_close()
            return
        station = self.server.station
        told: dict[str, Any] = {"state": state}
        words = station.words(self._since)
        if words:
            told["words"] = words
        new = [r for r in station.results if r["id"] > self._result]
        if new:
            self._result = new[-1]["id"]
            told["results"] = new
        self._send(told)

    async def on_message(self, message: str | bytes) -> None:
        """Do what the page asks, or say why not."""
        try:
            asked = understood(message, self.server.station.names)
        except BadRequest as error:
            self._send({"problem": str(error)})
            return
        if asked["do"] == "logs":
            if self.server.fetch is not None:
                self._send({"logs": await self.server.fetch(asked["drones"])})
            return
        station = self.server.station
        station.act(asked["do"], asked["drones"], self.server.now, asked.get("goals"))

    def _send(self, data: dict[str, Any]) -> None:
        try:
            self.write_message(json.dumps(data, allow_nan=False))
        except WebSocketClosedError:
            self.on_close()


def understood(message: str | bytes, names: list[str]) -> dict[str, Any]:
    """Return a page's request with its fields as they must be.

    Raises:
        BadRequest: it is none.
    """
    try:
        asked = json.loads(message)
        do, drones = str(asked["do"]), [str(d) for d in asked["drones"]]
    except (ValueError, TypeError, KeyError) as error:
        raise BadRequest(f"not understood: {error}") from error
    unknown = [d for d in drones if d not in names]
    if do not in (*ACTIONS, "logs") or unknown or not drones:
        raise BadRequest(f"not understood: {do} of {', '.join(unknown or drones) or 'no drone'}")
    if do != "goals":
        return {"do": do, "drones": drones}
    try:
        goals = [[float(x) for x in g] for g in asked["goals"]]
    except (ValueError, TypeError, KeyError) as error:
        raise BadRequest(f"goals must be lists of three numbers: {error}") from error
    if not 1 <= len(goals) <= _GOALS_MOST or any(len(g) != 3 for g in goals):
        raise BadRequest(f"goals must be 1 to {_GOALS_MOST} lists of three numbers")
    return {"do": do, "drones": drones, "goals": goals}
