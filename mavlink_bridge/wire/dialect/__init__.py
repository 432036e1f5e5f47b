"""Each message class to and from its MAVLink 2 message (common dialect), as two tables.

Units and frames change here and nowhere else. A module of `mavlink_bridge.wire.messages` has one
of the same name here, with both translations of its classes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mavlink_bridge.wire.dialect import protocols, sensors, setpoints, state, status
from mavlink_bridge.wire.messages import Message

TO_WIRE: dict[type, Callable[[Any], Any]] = {
    **setpoints.TO_WIRE,
    **state.TO_WIRE,
    **status.TO_WIRE,
    **sensors.TO_WIRE,
    **protocols.TO_WIRE,
}
"""What makes the fields of a MAVLink message (see `layout.message`) of each message class."""

FROM_WIRE: dict[int, Callable[[Any], Message]] = {
    **setpoints.FROM_WIRE,
    **state.FROM_WIRE,
    **status.FROM_WIRE,
    **sensors.FROM_WIRE,
    **protocols.FROM_WIRE,
}
"""What makes a message of the fields (see `unpack.unpacked`) of each MAVLink message, by its id."""

__all__ = ["FROM_WIRE", "TO_WIRE"]
