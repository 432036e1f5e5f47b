"""The parameter protocol of one vehicle: names, types and values as they cross the wire."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from mavlink_bridge.wire.ids import ParameterType
from mavlink_bridge.wire.messages import ParamRequestRead, ParamSet, ParamValue
from sitl_sim.vehicles.firmware.flavour import Flavour, Settings

_LARGEST = (2.0 - 2.0**-23) * 2.0**127  # of a float32
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
        """Return the settings that the values stand for."""
        return self._flavour.settings(self._values)

    def all(self) -> list[ParamValue]:
        """Return every parameter, for PARAM_REQUEST_LIST."""
        return [self._message(name) for name in self._names]

    def read(self, m: ParamRequestRead) -> list[ParamValue]:
        """Answer PARAM_REQUEST_READ; nothing where there is no such parameter."""
        if m.index >= 0:
            return [self._message(self._names[m.index])] if m.index < len(self._names) else []
        return [self._message(m.name)] if m.name in self._types else []

    def write(self, m: ParamSet) -> list[ParamValue]:
        """Answer PARAM_SET with the value that holds now; one that does not fit is refused."""
        if m.name not in self._types:
            return []
        value = self._decode(m.value, m.param_type)
        if not unfit(self._flavour, m.name, value):
            self._values[m.name] = value
        return [self._message(m.name)]

    def _decode(self, raw: float, param_type: int) -> float:
        if self._flavour.bytewise and param_type != ParameterType.REAL32:
            return float(struct.unpack("<i", struct.pack("<f", raw))[0])
        return (
            raw
            if param_type == ParameterType.REAL32 or not math.isfinite(raw)
            else float(round(raw))
        )

    def _message(self, name: str) -> ParamValue:
        kind, value = self._types[name], self._values[name]
        if self._flavour.bytewise and kind != ParameterType.REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return ParamValue(name, value, kind, len(self._names), self._names.index(name))
