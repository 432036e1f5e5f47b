"""Actions on many vehicles that obey signed commands alone, which MAVSDK cannot send.

They are those of `companion ground` (`actions.py`), sent by its station and signed with its key.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path

from companion.ground.drone_view import DroneView
from companion.ground.row import Row
from companion.ground.station import Station
from companion.process.signing_keys import SigningKeyError, Timestamps, open_signing
from companion.settings.config import CompanionConfig
from companion.settings.conflicts import Drone
from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire.link import Endpoint, open_endpoint

SYSTEM = 245  # system id as of MAVSDK's ground stations: vehicles see one `companion fleet`
_LINK_ID = 3  # of signed messages; the page has 2, which may be open at the same time
_STEP = 0.02  # s between two looks at the link
_STATE = 3.0  # s for a vehicle's place and battery; the station asks for them every 2 s


class SignedAction:
    """One action of many drones, each begun as soon as its vehicle is heard; no I/O of its own."""

    def __init__(
        self, action: str, drones: Sequence[CompanionConfig], station: Station, until: float
    ) -> None:
        """until: s, of the clock of `step`, for vehicles to appear."""
        self.rows = {d.link.system_id: Row(d.name, d.link.system_id) for d in drones}
        self._action, self._station, self._until = action, station, until
        self._numbers: dict[int, int] = {}  # of actions that began, by system
        self._heard_at: dict[int, float] = {}
        self._left = set(self.rows)

    def step(self, now: float) -> bool:
        """Hear and ask the vehicles; return whether each has its row. now: s, a steady clock."""
        self._station.step(now)
        for system in list(self._left):
            view = self._station.drones[system]
            if view.armed is not None:  # its heartbeat is there
                self._heard_at.setdefault(system, now)
            if system in self._heard_at:
                self._go_on(view, now)
            elif now > self._until:
                self._left.remove(system)
        return not self._left

    def _go_on(self, view: DroneView, now: float) -> None:
        """Begin the action of a drone, or fill in its row where the action has ended."""
        row = self.rows[view.system]
        if self._action == "status":
            known = view.height is not None and view.battery is not None
            if not known and now - self._heard_at[view.system] < _STATE:
                return
            row.ok, row.result = True, "done"
        else:
            if view.system not in self._numbers:
                number = self._station.act(self._action, [row.drone], now)
                self._numbers[view.system] = number
            number = self._numbers[view.system]
            told = next((r for r in self._station.results if r["number"] == number), None)
            if told is None:
                return
            row.ok, row.result = told["ok"], told["result"]
        row.armed, row.mode = view.armed, view.mode
        row.height = None if view.height is None else round(view.height, 1)
        row.battery_percent = None if view.battery is None else round(100.0 * view.battery[1])
        self._left.remove(view.system)


def act_signed(
    action: str,
    drones: Sequence[CompanionConfig],
    timestamps: Timestamps,
    url: str,
    patience: float,
) -> list[Row]:
    """Do `action` with every drone as soon as it is heard; return a row for each.

    url: as MAVSDK writes it. patience: s, for vehicles to appear.

    Raises:
        EndpointError: the URL cannot be opened; the message names it.
    """
    with contextlib.closing(_opened(url)) as endpoint:
        station = Station(drones, endpoint, SYSTEM, timestamps.signing)
        told = SignedAction(action, drones, station, time.monotonic() + patience)
        timestamps.tick(time.monotonic())
        while not told.step(time.monotonic()):
            time.sleep(_STEP)
            timestamps.tick(time.monotonic())
    return list(told.rows.values())


def key_of(drones: Sequence[Drone], file: Path | None = None) -> Timestamps | None:
    """Return the key with which the drones sign, and its time; None where none of them signs.

    file: of the key on this computer; None: where the drones' own files say.

    Raises:
        SettingsError: a key cannot be read on this computer, or the drones have not all the same.
    """
    first: Timestamps | None = None
    problems: list[str] = []
    if all(d.config.link.signing is None for d in drones):
        return None
    for d in drones:
        place, signing = f"{d.place('link.signing')}: link.signing", d.config.link.signing
        if signing is None:
            problems.append(f"{place}: not set, as it is for others: --only those that sign")
            continue
        try:
            made = open_signing("fleet", str(file or signing.key), _LINK_ID)
        except SigningKeyError as error:
            problems.append(f"{place}: {error}; here it may be --signing-key FILE")
            continue
        if first is not None and made.signing.key != first.signing.key:
            problems.append(f"{place}: another key than other drones have: --only those with one")
        first = first or made
    if problems:
        raise SettingsError(problems)
    return first


def _opened(url: str) -> Endpoint:
    """Open the endpoint that MAVSDK calls `url`."""
    return open_endpoint(url.replace("://", ":", 1).replace("tcpout:", "tcp:", 1))
