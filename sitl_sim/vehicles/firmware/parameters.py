"""The parameter protocol of one vehicle: names, types and values as they cross the wire."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import replace

from mavlink_bridge.wire.ids import ParameterError, ParameterType
from mavlink_bridge.wire.messages import ParamError, ParamRequestRead, ParamSet, ParamValue
from sitl_sim.vehicles.firmware.flavour import Flavour, Settings

_LARGEST = (2.0 - 2.0**-23) * 2.0**127  # of a float32
HASH, NO_INDEX = "_HASH_CHECK", 0xFFFF
_ALMOST = 0.01  # by which a whole number may fall short
_HASH_BITS = 0x7F7FFFFF  # of the checksum: no NaN, whose bits a float may lose on its way
RANGES: dict[int, tuple[float, float]] = {
    ParameterType.INT8: (-128, 127),
    ParameterType.INT16: (-32768, 32767),
    ParameterType.INT32: (-(2**31), 2**31 - 1),
    ParameterType.REAL32: (-_LARGEST, _LARGEST),
}


def unfit(flavour: Flavour, name: str, value: float) -> str:
    """Return why a parameter cannot have this value; empty where it can."""
    if name not in flavour.parameters:
        valid = ", ".join(sorted(flavour.parameters))
        return f"{flavour.name} has no such parameter; valid: {valid}"
    kind = flavour.parameters[name][0]
    low, high = RANGES[kind]
    if low <= value <= high and (kind == ParameterType.REAL32 or value == int(value)):
        return ""
    what = "number" if kind == ParameterType.REAL32 else "whole number"
    return f"must be a {what}, {low:.10g}…{high:.10g}, got {value:g}"


class Parameters:
    """A flavour's parameters, in the order of their names."""

    def __init__(self, flavour: Flavour, overrides: Mapping[str, float]) -> None:
        self._flavour = flavour
        self._types = {name: flavour.parameters[name][0] for name in sorted(flavour.parameters)}
        self._values = {name: float(flavour.parameters[name][1]) for name in self._types}
        self._names = list(self._types)
        for name, value in overrides.items():
            if why := unfit(flavour, name, value):
                raise ValueError(f"{name}: {why}")
            self._values[name] = float(value)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __len__(self) -> int:
        return len(self._names)

    def settings(self) -> Settings:
        """Return the settings that the values stand for; NaN stands for the default."""
        defaults = self._flavour.parameters
        values = {k: defaults[k][1] if math.isnan(v) else v for k, v in self._values.items()}
        return self._flavour.settings(values)

    def all(self) -> list[ParamValue]:
        """Return every parameter, for PARAM_REQUEST_LIST; a PX4 adds a hash of them all."""
        hashed = [self._hash()] if self._flavour.strict_parameters else []
        return [*(self._message(name) for name in self._names), *hashed]

    def read(self, m: ParamRequestRead, to: tuple[int, int]) -> list[ParamValue | ParamError]:
        """Answer PARAM_REQUEST_READ; where there is no such parameter, PX4 says so.

        to: system and component that asked.
        """
        strict = self._flavour.strict_parameters
        if m.index >= 0:
            if m.index < len(self._names):
                return [self._message(self._names[m.index])]
            return self._refused(to, "", m.index, ParameterError.DOES_NOT_EXIST)
        if self._own(m.name) in self._types:
            return [self._told(m.name)]
        if strict and m.name == HASH:
            return [self._hash()]
        return self._refused(to, m.name, -1, ParameterError.DOES_NOT_EXIST)

    def write(self, m: ParamSet, to: tuple[int, int]) -> list[ParamValue | ParamError]:
        """Answer PARAM_SET with the value that holds now; one that does not fit is refused.

        PX4 wants the parameter's own type, and stores any float, NaN too.
        """
        own = self._own(m.name)
        if own not in self._types:
            return self._refused(to, m.name, -1, ParameterError.DOES_NOT_EXIST)
        strict, kind = self._flavour.strict_parameters, self._types[own]
        if strict and m.param_type not in (ParameterType.INT32, ParameterType.REAL32):
            return self._refused(to, m.name, -1, ParameterError.TYPE_UNSUPPORTED)
        if strict and m.param_type != kind:
            return self._refused(to, m.name, -1, ParameterError.TYPE_MISMATCH)
        if not strict and not math.isfinite(m.value):
            return []  # ArduCopter neither takes nor answers it
        value = self._decode(m.value, m.param_type) if strict else _nearest(m.value, kind)
        any_float = strict and kind == ParameterType.REAL32
        if any_float or not unfit(self._flavour, own, value):
            self._values[own] = value
        return [self._told(m.name)]

    def _own(self, name: str) -> str:
        """Return a parameter's own name: ArduCopter minds no case."""
        return name if self._flavour.strict_parameters else name.upper()

    def _told(self, name: str) -> ParamValue:
        """Return a value that was asked for by name; ArduCopter gives no index, and that name."""
        told = self._message(self._own(name))
        strict = self._flavour.strict_parameters
        return told if strict else replace(told, name=name, index=NO_INDEX)

    def _refused(
        self, to: tuple[int, int], name: str, index: int, error: int
    ) -> list[ParamValue | ParamError]:
        return [ParamError(*to, name, index, error)] if self._flavour.strict_parameters else []

    def _decode(self, raw: float, param_type: int) -> float:
        if param_type == ParameterType.REAL32:
            return raw
        return float(struct.unpack("<i", struct.pack("<f", raw))[0])

    def _message(self, name: str) -> ParamValue:
        kind, value = self._types[name], self._values[name]
        if self._flavour.strict_parameters and kind != ParameterType.REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return ParamValue(name, value, kind, len(self._names), self._names.index(name))

    def _hash(self) -> ParamValue:
        """Return the checksum by which a client knows whether its cache still holds."""
        told = b"".join(n.encode() + struct.pack("<f", self._values[n]) for n in self._names)
        number = zlib.crc32(told) & _HASH_BITS
        value = struct.unpack("<f", struct.pack("<I", number))[0]
        return ParamValue(HASH, value, ParameterType.UINT32, len(self._names), NO_INDEX)


def _nearest(value: float, kind: int) -> float:
    """Return what ArduCopter makes of a value: within the type's range, whole numbers cut."""
    low, high = RANGES[kind]
    if kind != ParameterType.REAL32:
        value = math.trunc(value + math.copysign(_ALMOST, value))
    return float(min(max(value, low), high))
