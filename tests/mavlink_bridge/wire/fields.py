"""Frames of given fields, made and read by pymavlink."""

from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.codec import Codec


def written(name, fields):
    """The frame of these fields by pymavlink: number 0 of system 1, component 1."""
    return getattr(mavlink, f"MAVLink_{name.lower()}_message")(**fields).pack(
        mavlink.MAVLink(None, 1, 1)
    )


def shown(frame):
    """All fields of a frame by pymavlink, as text: NaN equals NaN, and -0 equals 0."""
    (message,) = mavlink.MAVLink(None).parse_buffer(frame)
    fields = {}
    for name, value in message.to_dict().items():
        values = value if isinstance(value, list) else [value]
        fields[name] = [str(round(v, 6) + 0.0) if isinstance(v, float) else str(v) for v in values]
    return fields


def wire(message):
    """The message as pymavlink reads it."""
    (read,) = mavlink.MAVLink(None).parse_buffer(Codec(1, 1).encode([message]))
    return read


def heard(name, fields):
    """The message that the codec makes of these fields."""
    (received,) = Codec(1, 191).decode(written(name, fields))
    return received.message
