"""Setup of a Betaflight flight controller: its version, rates, switches and receiver.

The bridge reads it once over MSP when the line comes up. It refuses a setup that cannot fly, and
names the line to type into the controller's CLI.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.msp import ModeRange, Msp, MspError
from mavlink_bridge.betaflight.rate_profile import RateProfile, rate_profile
from mavlink_bridge.shared.arrays import Vector

OLDEST_API = (1, 43)  # Betaflight 4.2: MSP_RC_TUNING holds the kind of rates
_RX_MSP = 1 << 14  # FEATURE_CONFIG
_BOX_ARM, _BOX_ANGLE, _BOX_OVERRIDE = 0, 1, 50  # permanent box ids
_FIX_ARM, _FIX_ANGLE = "aux 0 0 0 1700 2100 0 0", "aux 1 1 1 1700 2100 0 0"
NEUTRAL, LOW, FULL = 1500, 1000, 500
_AUX_1 = 4  # index of AUX1 among the channels
_CHANNELS = 16
# Betaflight 2026.6: MSP OVERRIDE ends 300 ms after the last frame. Older versions hold the last
# frame for ever, and before the first frame the hand-over sets all channels, ARM too, to lowest.
_OVERRIDE_ENDS = (1, 48)

QUESTIONS = (
    Msp.API_VERSION,
    Msp.FC_VARIANT,
    Msp.FC_VERSION,
    Msp.FEATURE_CONFIG,
    Msp.RX_MAP,
    Msp.BOXIDS,
    Msp.MODE_RANGES,
    Msp.RC_TUNING,
)
_LEAST = {Msp.API_VERSION: 3, Msp.FC_VERSION: 3, Msp.FEATURE_CONFIG: 4, Msp.RX_MAP: 4}  # bytes


@dataclass(frozen=True)
class Controller:
    """Setup of one controller, as far as the bridge needs it.

    version: e.g. '4.6.0'. order: channel of roll, pitch, yaw, throttle. arm_bit, override_bit: bits
    in the mode flags of STATUS_EX. only_receiver: the bridge is the only receiver (feature
    RX_MSP); otherwise a pilot hands over by MSP OVERRIDE.
    """

    version: str
    api: tuple[int, int]
    profile: RateProfile
    order: tuple[int, ...]
    arm: ModeRange
    angle: ModeRange
    arm_bit: int
    override_bit: int | None
    only_receiver: bool

    @property
    def sw_version(self) -> int:
        """The version as AUTOPILOT_VERSION has it: a byte for each part, and a release's mark."""
        major, minor, patch = (int(n) for n in self.version.split("."))
        return major << 24 | minor << 16 | patch << 8 | 0xFF

    def channels(self, sticks: Vector, thrust: float, armed: bool, level: bool) -> list[int]:
        """Return the RC channels [µs]; NaN gives a neutral stick and no throttle.

        sticks: (3,) deflections −1…1 of roll, pitch, yaw, positive to the right, nose down, to the
        right, as Betaflight counts them. level: ANGLE mode on.
        """
        out = [NEUTRAL] * _AUX_1 + [LOW] * (_CHANNELS - _AUX_1)
        values = [NEUTRAL + FULL * _within(float(s), -1.0, 1.0) for s in sticks]
        values.append(LOW + 2 * FULL * _within(thrust, 0.0, 1.0))
        for value, channel in zip(values, self.order, strict=True):
            out[channel] = round(value)
        for switch, on in ((self.arm, armed), (self.angle, level)):
            out[_AUX_1 + switch.aux] = switch.middle if on else _off(switch)
        return out

    def rate_sticks(self, omega: Vector) -> tuple[float, float, float]:
        """Return the deflections of roll, pitch, yaw for body rates (3,) rad/s, FLU."""
        p = self.profile
        return (
            p.roll.stick_for(float(omega[0])),
            p.pitch.stick_for(float(omega[1])),
            p.yaw.stick_for(-float(omega[2])),
        )

    def report(self) -> list[str]:
        """Return the setup as lines for a person at the console."""
        p = self.profile
        full = ", ".join(f"{math.degrees(a.rate_of(1.0)):.0f}" for a in (p.roll, p.pitch, p.yaw))
        lines = [
            f"Betaflight {self.version}, MSP API {self.api[0]}.{self.api[1]}",
            f"rates at full stick: roll, pitch, yaw {full} °/s",
            f"arms by AUX{self.arm.aux + 1}, ANGLE by AUX{self.angle.aux + 1}",
        ]
        if self.only_receiver:
            lines.append("receiver: this bridge alone (feature RX_MSP); no pilot can take over")
        else:
            used = (0, 1, 2, 3, _AUX_1 + self.arm.aux, _AUX_1 + self.angle.aux)
            mask = sum(1 << k for k in used)
            lines.append(
                "receiver: the pilot's, or this bridge while mode MSP OVERRIDE is on; MSP does not "
                f"report the mask: set msp_override_channels_mask = {mask} or more in the CLI"
            )
        return lines


def _within(value: float, low: float, high: float) -> float:
    """Return the nearest value in [low, high]; 0 for NaN."""
    return 0.0 if math.isnan(value) else min(max(value, low), high)


def _off(switch: ModeRange) -> int:
    """Return a channel value [µs] outside the switch's range."""
    return LOW if switch.low > LOW else 2000


def read_controller(answers: dict[Msp, bytes]) -> Controller:
    """Return the setup from the answers to QUESTIONS.

    Raises:
        MspError: one line: not Betaflight, too old, or not set up to fly.
    """
    _check_variant(answers)
    api = _check_api(answers[Msp.API_VERSION])
    boxes = list(answers[Msp.BOXIDS])
    if _BOX_ARM not in boxes:
        raise MspError("MSP_BOXIDS names no ARM")
    ranges = msp.mode_ranges(answers[Msp.MODE_RANGES])
    features = int.from_bytes(answers[Msp.FEATURE_CONFIG][:4], "little")
    only_receiver = bool(features & _RX_MSP)
    if not only_receiver:
        _check_override(api, boxes, ranges)
    controller = Controller(
        version=".".join(str(b) for b in answers[Msp.FC_VERSION][:3]),
        api=api,
        profile=rate_profile(answers[Msp.RC_TUNING]),
        order=_order(answers[Msp.RX_MAP]),
        arm=_switch(ranges, _BOX_ARM, "ARM", _FIX_ARM),
        angle=_switch(ranges, _BOX_ANGLE, "ANGLE", _FIX_ANGLE),
        arm_bit=boxes.index(_BOX_ARM),
        override_bit=None if only_receiver else boxes.index(_BOX_OVERRIDE),
        only_receiver=only_receiver,
    )
    _check_switches(controller, ranges)
    return controller


def _check_variant(answers: dict[Msp, bytes]) -> None:
    """Refuse firmware other than Betaflight, and answers that are cut short."""
    variant = answers[Msp.FC_VARIANT][:4].decode("ascii", "replace")
    if variant != "BTFL":
        raise MspError(f"flight controller runs {variant!r}, not Betaflight ('BTFL')")
    for question, size in _LEAST.items():
        if len(answers[question]) < size:
            raise MspError(f"the answer to MSP_{question.name} is too short")


def _check_api(answer: bytes) -> tuple[int, int]:
    """Return the MSP API version; refuse an old one."""
    api = (answer[1], answer[2])
    if api < OLDEST_API:
        raise MspError(
            f"MSP API {api[0]}.{api[1]} is too old: needs {OLDEST_API[0]}.{OLDEST_API[1]} "
            "(Betaflight 4.2) or newer"
        )
    return api


def _check_override(api: tuple[int, int], boxes: list[int], ranges: list[ModeRange]) -> None:
    """Refuse a setup in which a pilot cannot hand over, or get a silent bridge's control back."""
    if not any(r.box == _BOX_OVERRIDE for r in ranges):
        raise MspError(
            "no RC input for the bridge: neither feature RX_MSP nor a switch for mode MSP "
            "OVERRIDE; CLI: aux 2 50 2 1700 2100 0 0, and set msp_override_channels_mask"
        )
    if _BOX_OVERRIDE not in boxes:
        raise MspError(
            "mode MSP OVERRIDE has a switch but is not available (MSP_BOXIDS): "
            "CLI: set msp_override_channels_mask"
        )
    if api < _OVERRIDE_ENDS:
        raise MspError(
            f"MSP API {api[0]}.{api[1]} disarms when MSP OVERRIDE hands over and holds its last "
            f"frame for ever; needs {_OVERRIDE_ENDS[0]}.{_OVERRIDE_ENDS[1]} (Betaflight 2026.6) or "
            "newer, or feature RX_MSP"
        )


def _check_switches(controller: Controller, ranges: list[ModeRange]) -> None:
    """Refuse switches by which `channels` cannot set ARM and ANGLE independently."""
    if controller.arm.aux == controller.angle.aux:
        raise MspError(
            f"modes ARM and ANGLE are both on AUX{controller.arm.aux + 1}: "
            f"each needs its own; CLI: {_FIX_ANGLE}"
        )
    off = controller.channels(np.zeros(3), 0.0, armed=False, level=False)[_AUX_1:]
    # Beside a pilot's receiver, the bridge sets these two channels only.
    both = (controller.arm.aux, controller.angle.aux)
    ours = range(len(off)) if controller.only_receiver else both
    modes = {_BOX_ARM: ("ARM", _FIX_ARM), _BOX_ANGLE: ("ANGLE", _FIX_ANGLE)}
    for r in ranges:
        if r.box in modes and r.aux in ours and r.holds(off[r.aux]):
            name, fix = modes[r.box]
            raise MspError(
                f"mode {name} cannot be switched off: AUX{r.aux + 1} has it on from "
                f"{r.low} to {r.high} µs, {off[r.aux]} µs included; CLI: {fix}"
            )


def _order(rx_map: bytes) -> tuple[int, ...]:
    """Return the channels of roll, pitch, yaw, throttle in a raw frame."""
    roll, pitch, yaw, throttle = rx_map[:4]
    if sorted(rx_map[:4]) != list(range(_AUX_1)):
        raise MspError(f"MSP_RX_MAP {list(rx_map[:4])} is no order of the first four channels")
    return roll, pitch, yaw, throttle


def _switch(ranges: list[ModeRange], box: int, name: str, fix: str) -> ModeRange:
    for r in ranges:
        if r.box == box and r.aux < _CHANNELS - _AUX_1:
            return r
    raise MspError(f"no switch for mode {name}; CLI: {fix}")


Query = Callable[[Msp], bytes | None]


def query_controller(query: Query) -> Controller:
    """Return the setup of a controller.

    query: returns the answer to one command, None where the controller gives none.

    Raises:
        MspError: the controller does not answer, or cannot fly.
    """
    answers: dict[Msp, bytes] = {}
    for command in QUESTIONS:
        payload = query(command)
        if payload is None:
            raise MspError(f"flight controller does not answer MSP_{command.name}")
        answers[command] = payload
        if command is Msp.FC_VARIANT and payload[:4] != b"BTFL":
            break  # other firmware may not know the remaining commands
    answers = {q: answers.get(q, b"") for q in QUESTIONS}
    return read_controller(answers)
