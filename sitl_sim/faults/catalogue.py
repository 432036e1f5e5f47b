"""Faults of a flight as data: `faults: [{kind, drone, at, for, amount}]` of a scenario.

In lockstep every fault is deterministic: each draws from a generator of its own for each drone,
seeded by the scenario's seed and the fault's index in the list. Events from outside the flight
(a killed or stopped process, a second companion, an unplugged line) are not in the catalogue.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from mavlink_bridge.shared.settings import Contradiction, SettingsError, StrictModel

Kind = Literal[
    "link_loss", "link_duplicate", "link_reorder", "link_flip", "link_garbage", "link_foreign",
    "link_replay", "link_reflect", "link_flood", "link_spoof", "link_forge",
    "telemetry_nan", "telemetry_stale", "telemetry_late", "quaternion", "position_lost",
    "position_jump", "position_reset", "rtk_float", "compass", "height_drift",
    "velocity_slide",
    "stamps", "clock_jump", "timesync_jump",
    "camera_dead", "camera_frozen", "camera_black", "camera_saturated", "camera_late",
    "camera_fog",
    "camera_mirrored", "camera_upside_down", "camera_rolled", "camera_pitched", "camera_yawed",
    "camera_scaled", "camera_misdated", "camera_vibration",
    "missed", "ghosts", "swaps", "range_bias",
    "stop", "turn_into", "kill", "disarm", "mode", "reboot",
    "battery", "motor", "thrust_scale", "gust", "gyro_bias",
    "pause", "disk_full",
]  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """Meaning of a kind's `amount`: text with unit, default, least and most."""

    text: str
    default: float | None = None
    low: float = 0.0
    high: float = 1.0


_SHARE = 0.2
KINDS: dict[str, Meaning] = {
    "link_loss": Meaning("share of MAVLink packets lost, each way", _SHARE),
    "link_duplicate": Meaning("share of packets that come twice", _SHARE),
    "link_reorder": Meaning("share of telemetry packets that come after the next one", _SHARE),
    "link_flip": Meaning("share of packets with flipped bits", _SHARE),
    "link_garbage": Meaning("B/s of garbage, cut and mutated frames to the companion",
                            1e6, 0.0, 1e8),
    "link_foreign": Meaning("heartbeats per second of systems that do not exist", 50, 0, 1e4),
    "link_replay": Meaning("packets per second, each way, that were sent before, either way",
                           50, 0, 1e4),
    "link_reflect": Meaning("share of the companion's packets that come back to it", 1.0),
    "link_flood": Meaning("B/s of first bytes of frames to the companion", 1e6, 0.0, 1e8),
    "link_spoof": Meaning("heartbeats per second with the vehicle's ids, unsigned", 50, 0, 1e4),
    "link_forge": Meaning("commands per second to the vehicle, unsigned, to disarm by force",
                          5, 0, 1e4),
    "telemetry_nan": Meaning("share of attitudes and positions with a NaN or an infinity", 1.0),
    "telemetry_stale": Meaning("attitude and position stop; the heartbeat goes on"),
    "telemetry_late": Meaning("s that attitude and position come late", 0.1, 0.0, 5.0),
    "quaternion": Meaning("factor on the length of the attitude quaternion", 0.5, 0.0, 10.0),
    "position_lost": Meaning("no position: GPS fails, LOCAL_POSITION_NED stops"),
    "position_jump": Meaning("m that the position estimate jumps, east", 3.0, -1e3, 1e3),
    "position_reset": Meaning("m that the estimate jumps, to any side; its reset counter counts it",
                              3.0, 0.0, 1e3),
    "rtk_float": Meaning("m that an RTK solution is off while it floats", 0.4, 0.0, 10.0),
    "compass": Meaning("degrees that the compass is wrong", 20.0, -180.0, 180.0),
    "height_drift": Meaning("m/min that the height drifts upwards", 1.0, -60.0, 60.0),
    "velocity_slide": Meaning("m/s at which the position slides to any side; the velocity shows it",
                              0.8, 0.0, 10.0),
    "stamps": Meaning("s that stamps of attitude and position are ahead", 0.12, -1e6, 1e6),
    "clock_jump": Meaning("s that the wall clock told by SYSTEM_TIME jumps", 3600, -1e6, 1e6),
    "timesync_jump": Meaning("s that TIMESYNC jumps", 0.5, -1e6, 1e6),
    "camera_dead": Meaning("no pictures"),
    "camera_frozen": Meaning("the same picture again and again"),
    "camera_black": Meaning("black pictures"),
    "camera_saturated": Meaning("white pictures"),
    "camera_fog": Meaning("share of the contrast that is lost: a lens that fogs up", 0.98),
    "camera_mirrored": Meaning("pictures with left and right exchanged"),
    "camera_upside_down": Meaning("pictures turned by 180°"),
    "camera_rolled": Meaning("° by which the camera is turned about its axis", 10.0, -45.0, 45.0),
    "camera_pitched": Meaning("° by which the camera looks too high", 10.0, -30.0, 30.0),
    "camera_yawed": Meaning("° by which the camera looks too far left", 10.0, -30.0, 30.0),
    "camera_scaled": Meaning("factor on the focal length", 1.1, 0.5, 2.0),
    "camera_misdated": Meaning("s that stamps are after the capture", 0.1, -0.5, 0.5),
    "camera_vibration": Meaning("° by which the camera shakes about each axis, at most; no gyro "
                                "tells it", 1.0, 0.0, 10.0),
    "camera_late": Meaning("s that pictures come late", 0.2, 0.0, 5.0),
    "missed": Meaning("share of detections missed", 0.3),
    "ghosts": Meaning("share of frames with a neighbour that does not exist", 0.05),
    "swaps": Meaning("share of frames whose detections change places", 0.2),
    "range_bias": Meaning("factor on the range of detections", 1.2, 0.1, 10.0),
    "stop": Meaning("the vehicle stops dead: its pilot holds"),
    "turn_into": Meaning("m/s at which it flies straight at its nearest neighbour", 1.0, 0.1, 5),
    "kill": Meaning("kill switch: its motors stop in flight"),
    "disarm": Meaning("its pilot asks to disarm, again and again"),
    "mode": Meaning("its pilot changes the mode, `to`"),
    "reboot": Meaning("the autopilot restarts"),
    "battery": Meaning("share of the charge that remains", 0.1),
    "motor": Meaning("factor on the thrust of one motor", 0.8, 0.0, 2.0),
    "thrust_scale": Meaning("factor on the thrust of all motors", 0.8, 0.1, 2.0),
    "gust": Meaning("m/s of wind on top, from any side", 5.0, 0.0, 30.0),
    "gyro_bias": Meaning("rad/s on every axis of the gyro", 0.05, -1.0, 1.0),
    "pause": Meaning("s that each answer of the companion comes late", 0.2, 0.0, 5.0),
    "disk_full": Meaning("the companion's log cannot grow"),
}  # fmt: skip
EMULATED = frozenset(
    {
        "telemetry_nan",
        "telemetry_stale",
        "telemetry_late",
        "quaternion",
        "clock_jump",
        "timesync_jump",
        "position_lost",
        "position_jump",
        "position_reset",
        "rtk_float",
        "compass",
        "height_drift",
        "velocity_slide",
        "stop",
        "turn_into",
        "kill",
        "disarm",
        "mode",
        "reboot",
        "battery",
        "gyro_bias",
    }
)
"""Kinds that only an emulated autopilot can have."""
LINE = frozenset(kind for kind in KINDS if kind.startswith("link_"))
"""Kinds that only a line can have that passes through the simulator."""
PIXELS = frozenset(
    {
        "camera_black",
        "camera_saturated",
        "camera_fog",
        "camera_mirrored",
        "camera_upside_down",
        "camera_rolled",
        "camera_pitched",
        "camera_yawed",
        "camera_scaled",
        "camera_vibration",
    }
)
"""Kinds that only a camera can have: a perfect detector has no picture."""
REPORTS = frozenset({"missed", "ghosts", "swaps", "range_bias"})
"""Kinds that change what a perfect detector reports (`sensing.neighbours: truth`)."""

PROCESSES = frozenset({"disk_full"})
"""Kinds that the system does to a companion's process: one inside the simulator has none."""

PilotMode = Literal["hold", "land", "return", "position", "stabilized"]


class FaultConfig(StrictModel):
    """One fault: its kind, its drone, its time and its amount."""

    kind: Kind
    drone: str = Field("all", description="A drone's name, or all.")
    at: float = Field(0.0, ge=0, description="It begins [s of the flight].")
    duration: float | None = Field(
        None, gt=0, alias="for", description="It lasts [s]; to the end where not given."
    )
    amount: float | None = Field(None, description="Amount; each kind has its own unit.")
    to: PilotMode | None = Field(None, description="Of `mode`: the mode that the pilot chooses.")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        meaning = KINDS[self.kind]
        if self.amount is not None and meaning.default is None:
            raise Contradiction(("amount",), f"{self.kind} takes none: {meaning.text}")
        if self.amount is not None and not meaning.low <= self.amount <= meaning.high:
            limits = f"{meaning.low:g}…{meaning.high:g} ({meaning.text})"
            raise Contradiction(("amount",), f"{self.kind} takes {limits}, got {self.amount:g}")
        if (self.kind == "mode") != (self.to is not None):
            raise Contradiction(
                ("to", "kind"), f"belongs to kind mode: {', '.join(get_args(PilotMode))}"
            )
        return self

    @property
    def value(self) -> float:
        """`amount`, or the default of the kind."""
        default = KINDS[self.kind].default
        return self.amount if self.amount is not None else default if default is not None else 1.0

    def active(self, now: float) -> bool:
        """Return whether the fault is present at `now` [s of the flight]."""
        return self.at <= now < self.at + (self.duration or np.inf)


@dataclass(frozen=True)
class Fault:
    """A fault of drone i, with a random generator of its own."""

    config: FaultConfig
    i: int
    rng: np.random.Generator

    @property
    def kind(self) -> str:
        """The kind of the fault."""
        return self.config.kind

    @property
    def value(self) -> float:
        """The amount, or the default of the kind."""
        return self.config.value

    def strikes(self) -> bool:
        """Draw whether this packet, frame or detection is affected; `value` is a share."""
        return bool(self.rng.random() < self.value)


class Schedule:
    """The faults of a flight, by drone.

    Raises:
        SettingsError: a fault names a drone that does not exist; with the valid names.
    """

    def __init__(self, configs: Sequence[FaultConfig], names: Sequence[str], seed: int) -> None:
        self._faults: list[list[Fault]] = [[] for _ in names]
        for number, config in enumerate(configs):
            for i in _affected(number, config, names):
                rng = np.random.default_rng([seed, 0xFA, number, i])
                self._faults[i].append(Fault(config, i, rng))

    def all(self) -> Iterator[Fault]:
        """Yield every fault of every drone."""
        for faults in self._faults:
            yield from faults

    def has(self, i: int, *kinds: str) -> bool:
        """Return whether drone i ever has a fault of these kinds."""
        return any(f.config.kind in kinds for f in self._faults[i])

    def at(self, i: int, now: float, *kinds: str) -> list[Fault]:
        """Return drone i's faults of these kinds that are present now, in the scenario's order."""
        faults = self._faults[i]
        if not faults:  # asked for each packet and frame, most often in vain
            return []
        return [f for f in faults if f.config.kind in kinds and f.config.active(now)]


def _affected(number: int, config: FaultConfig, names: Sequence[str]) -> Iterable[int]:
    if config.drone == "all":
        return range(len(names))
    if config.drone not in names:
        raise SettingsError(
            [f"faults.{number}.drone: no drone {config.drone!r}; valid: all, {', '.join(names)}"]
        )
    return [list(names).index(config.drone)]


def check(
    configs: Sequence[FaultConfig],
    *,
    emulated: bool = True,
    line: bool = True,
    pixels: bool = True,
    reports: bool = True,
    processes: bool = True,
) -> None:
    """Refuse faults that this flight cannot have.

    emulated: its autopilots are emulated. line: their links pass through the simulator. pixels: it
    has cameras. reports: a perfect detector
    reports neighbours. processes: its companions are processes of their own.

    Raises:
        SettingsError: each impossible fault, with what it needs.
    """
    needs = [
        (EMULATED, emulated, "needs an emulated autopilot (drones.autopilot)"),
        (LINE, line, "needs px4 or ardupilot: a bridge speaks to its companion past the simulator"),
        (PIXELS, pixels, "needs a camera (sensing.neighbours or sensing.obstacles: camera)"),
        (REPORTS, reports, "needs sensing.neighbours: truth"),
        (PROCESSES, processes, "needs companions in processes of their own (no --in-process)"),
    ]
    problems = [
        f"faults.{n}.kind: {c.kind} {text}"
        for n, c in enumerate(configs)
        for kinds, there, text in needs
        if c.kind in kinds and not there
    ]
    if problems:
        raise SettingsError(problems)
