"""Strict YAML, layered, validated by pydantic; every error is `file:line:column: key: …`.

YAML 1.1's traps are refused rather than guessed: only `true` and `false` are booleans, `012`
is no number, neither are `.nan` and `.inf`, and a key may stand only once.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

Key = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of all settings: immutable, no unknown keys, no coercion, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class SettingsError(ValueError):
    """Every mistake found, one line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


@dataclass(frozen=True)
class Document:
    """Plain data, and where each value came from (`file:line:column` by key path)."""

    data: dict[str, Any] = field(default_factory=dict)
    places: dict[Key, str] = field(default_factory=dict)


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader whose scalars are only what they look like."""


_StrictLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"true|false", "tf"),
    ("null", r"~|null|", "~n"),
    ("int", r"[-+]?(0|[1-9][0-9_]*)|0x[0-9a-fA-F]+", "-+0123456789"),
    ("float", r"[-+]?(0|[1-9][0-9_]*)?(\.[0-9_]*)?([eE][-+]?[0-9]+)?", "-+.0123456789"),
):
    _StrictLoader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first)
    )


def load_yaml(path: Path) -> Document:
    """Read one file.

    Raises:
        SettingsError: no such file, bad YAML, a key twice, a list or scalar at the top.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise SettingsError([f"{path}: cannot be read: {reason}"]) from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, name: str) -> Document:
    """As `load_yaml`, for text; `name` stands in messages for the file."""
    loader = _StrictLoader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            return Document()
        if not isinstance(root, yaml.MappingNode):
            raise SettingsError([f"{_at(name, root)}: the file must hold `key: value` lines"])
        places: dict[Key, str] = {}
        problems: list[str] = []
        _walk(root, (), name, places, problems)
        if problems:
            raise SettingsError(problems)
        return Document(loader.construct_document(root), places)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        at = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        raise SettingsError([f"{at}: not YAML: {error.problem}"]) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        if isinstance(error, SettingsError):
            raise
        raise SettingsError([f"{name}: not YAML: {error}"]) from error
    finally:
        loader.dispose()


def merge(documents: Iterable[Document]) -> Document:
    """Lay the documents over each other, the last on top; lists are replaced whole."""
    merged = Document()
    for document in documents:
        _overlay(merged.data, document.data)
        merged.places.update(document.places)
    return merged


def assignments(items: Iterable[str], name: str = "--set") -> Document:
    """`path.to.key=value` arguments as a document; values are YAML."""
    documents = []
    for item in items:
        path, equals, value = item.partition("=")
        if not equals or not all(path.split(".")):
            raise SettingsError([f"{name} {item}: must be path.to.key=value"])
        keys = path.split(".")
        parsed = parse_yaml(f"v: {value}", f"{name} {item}").data["v"]
        data: dict[str, Any] = {keys[-1]: parsed}
        for key in reversed(keys[:-1]):
            data = {key: data}
        places: dict[Key, str] = {tuple(keys[: n + 1]): f"{name} {item}" for n in range(len(keys))}
        documents.append(Document(data, places))
    return merge(documents)


def validate(model: type[Model], document: Document, name: str) -> Model:
    """The document as a `model`.

    Raises:
        SettingsError: with every mistake, each at its place.
    """
    try:
        return model.model_validate(document.data)
    except ValidationError as error:
        raise SettingsError(
            [_explain(model, document, name, dict(e)) for e in error.errors()]
        ) from error


def _walk(
    node: yaml.Node, path: Key, name: str, places: dict[Key, str], problems: list[str]
) -> None:
    places[path] = _at(name, node)
    if isinstance(node, yaml.MappingNode):
        seen: dict[str, str] = {}
        for key_node, value_node in node.value:
            key, at = str(key_node.value), _at(name, key_node)
            if key in seen:
                problems.append(f"{at}: {_dotted((*path, key))}: stands twice, first {seen[key]}")
            seen[key] = at
            _walk(value_node, (*path, key), name, places, problems)
            places[(*path, key)] = at
    elif isinstance(node, yaml.SequenceNode):
        for n, item in enumerate(node.value):
            _walk(item, (*path, n), name, places, problems)


def _at(name: str, node: yaml.Node) -> str:
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def _overlay(below: dict[str, Any], above: Mapping[str, Any]) -> None:
    for key, value in above.items():
        if isinstance(value, Mapping):
            base = below.get(key)
            below[key] = dict(base) if isinstance(base, Mapping) else {}
            _overlay(below[key], value)
        else:
            below[key] = value


def _dotted(path: Sequence[str | int]) -> str:
    return ".".join(str(p) for p in path)


def _explain(model: type[BaseModel], document: Document, name: str, error: dict[str, Any]) -> str:
    """One pydantic error as `file:line:column: key: what is wrong, valid choices`."""
    location: Key = tuple(error["loc"])
    while location and location not in document.places and error["type"] != "missing":
        location = location[:-1]  # pydantic adds names of union members that no file has
    at = next(
        (document.places[location[:n]] for n in range(len(location), -1, -1)
         if location[:n] in document.places),
        name,
    )  # fmt: skip
    text = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        valid = _fields_at(model, location[:-1])
        close = difflib.get_close_matches(str(location[-1]), valid, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        text = f"unknown key; {hint}valid: {', '.join(valid)}"
    elif error["type"] == "missing":
        text = "is missing"
    elif not isinstance(error["input"], dict | list):
        text += f", got {error['input']!r}"
    return f"{at}: {_dotted(location) or '(whole file)'}: {text}"


def _fields_at(model: type[BaseModel], path: Key) -> list[str]:
    """Field names valid below `path`."""
    candidates: list[type[BaseModel]] = [model]
    for key in path:
        found: list[type[BaseModel]] = []
        for candidate in candidates:
            info = candidate.model_fields.get(str(key))
            found += _models_in(info.annotation) if info else [candidate]
        candidates = found or candidates
    return sorted({name for c in candidates for name in c.model_fields})


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Every settings class inside an annotation (unions, lists, dicts)."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, UnionType, list, tuple, dict) or get_args(annotation):
        return [m for a in get_args(annotation) for m in _models_in(a)]
    return []
