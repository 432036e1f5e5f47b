"""Payload of a message to send; `framing` makes the frame.

Source: https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

from typing import Any

from mavlink_bridge.wire.dialect.layout import Layout


def packed(fields: Any) -> bytes:
    """Return the payload of a message made by `layout.message`, all its bytes."""
    kind: Layout = type(fields).layout
    ordered = [fields[n] for n in kind.order]
    if kind.flat:
        return kind.form.pack(*ordered)
    values: list[Any] = []
    for field, length in zip(ordered, kind.lengths, strict=True):
        if length > 1:
            values += field[:length]
        else:
            values.append(field)
    return kind.form.pack(*values)
