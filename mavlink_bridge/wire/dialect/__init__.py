"""Each message class to and from its MAVLink 2 message (common dialect), as two tables.

Units and frames change here and nowhere else.
"""

from mavlink_bridge.wire.dialect.from_wire import FROM_WIRE
from mavlink_bridge.wire.dialect.to_wire import TO_WIRE

__all__ = ["FROM_WIRE", "TO_WIRE"]
