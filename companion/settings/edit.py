"""Changing values in a drone's YAML file; comments, order and layout of all else stay."""

from __future__ import annotations

import re
from collections.abc import Mapping

import yaml

Value = float | str | list[float]
_SAFE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_./-]*")


def edited(text: str, changes: Mapping[tuple[str, str], Value]) -> str:
    """Return the YAML text with other values; changes: by (section, key).

    A value that is there is replaced where it stands; a missing key or section is added at the end
    of its section or of the file. `airframe: quad5` becomes the mapping that it is short for.

    Raises:
        ValueError: a section is neither a mapping nor that short form.
    """
    for (section, key), value in changes.items():
        text = _set(text, section, key, _as_yaml(value))
    return text


def as_block(changes: Mapping[tuple[str, str], Value]) -> str:
    """Return the changes as YAML of their own."""
    return edited("", changes)


def _set(text: str, section: str, key: str, value: str) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is not None and not isinstance(root, yaml.MappingNode):
        raise ValueError("the file must hold `key: value` lines")
    node = None if root is None else _member(root, section)
    if node is None or _is_empty(node):
        if root is not None and node is None and root.flow_style:
            return _into_flow(text, root, f"{section}: {{{key}: {value}}}")
        if node is None:
            return _end_line(text) + f"{section}:\n  {key}: {value}\n"
        return _replace(text, node, f" {{{key}: {value}}}")
    if isinstance(node, yaml.ScalarNode) and section == "airframe":
        return _replace(text, node, f"{{name: {_text(text, node)}, {key}: {value}}}")
    if not isinstance(node, yaml.MappingNode):
        raise ValueError(f"{section} must hold keys")
    if (there := _member(node, key)) is not None:
        # A value in block style has lines of its own, the last of which ends before the next key.
        old = _text(text, there)
        tail = old[len(old.rstrip()) :] if not _flows(there) else ""
        return _replace(text, there, (" " if _is_empty(there) else "") + value + tail)
    if node.flow_style:
        return _into_flow(text, node, f"{key}: {value}")
    return _below(text, node, f"{key}: {value}")


def _member(node: yaml.MappingNode, key: str) -> yaml.Node | None:
    """Return the value of a key; None where it is missing."""
    found: yaml.Node | None = next((v for k, v in node.value if k.value == key), None)
    return found


def _is_empty(node: yaml.Node) -> bool:
    """Return whether a value is not there at all, as in `camera:`."""
    return isinstance(node, yaml.ScalarNode) and node.start_mark.index == node.end_mark.index


def _flows(node: yaml.Node) -> bool:
    """Return whether a value stands on its own, with an end that is seen."""
    return isinstance(node, yaml.ScalarNode) or bool(getattr(node, "flow_style", False))


def _text(text: str, node: yaml.Node) -> str:
    return text[node.start_mark.index : node.end_mark.index]


def _replace(text: str, node: yaml.Node, by: str) -> str:
    return text[: node.start_mark.index] + by + text[node.end_mark.index :]


def _into_flow(text: str, node: yaml.MappingNode, entry: str) -> str:
    """Return the text with an entry at the end of a mapping in braces."""
    if not node.value:
        return _replace(text, node, f"{{{entry}}}")
    last = node.value[-1][1].end_mark.index
    return f"{text[:last]}, {entry}{text[last:]}"


def _below(text: str, node: yaml.MappingNode, entry: str) -> str:
    """Return the text with an entry in a line after the last of a mapping in block style."""
    last = node.value[-1][1]
    while not _flows(last) and isinstance(last, yaml.MappingNode | yaml.SequenceNode):
        item = last.value[-1]
        last = item[1] if isinstance(last, yaml.MappingNode) else item
    end = text.find("\n", last.end_mark.index)
    head = text if end < 0 else text[: end + 1]
    rest = "" if end < 0 else text[end + 1 :]
    return f"{_end_line(head)}{' ' * node.start_mark.column}{entry}\n{rest}"


def _end_line(text: str) -> str:
    return text if not text or text.endswith("\n") else f"{text}\n"


def _as_yaml(value: Value) -> str:
    if isinstance(value, str):
        return value if _SAFE.fullmatch(value) else f"'{value.replace(chr(39), chr(39) * 2)}'"
    if isinstance(value, list):
        return f"[{', '.join(f'{v:.10g}' for v in value)}]"
    return f"{value:.10g}"
