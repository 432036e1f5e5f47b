"""Validation errors as lines `file:line:column: key: mistake; valid choices`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from types import UnionType
from typing import Any, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

Key = tuple[str | int, ...]
_WANTED = {
    "bool_type": "must be true or false",
    "int_type": "must be a whole number",
    "float_type": "must be a number",
    "string_type": "must be text, in quotes where it looks like something else",
    "list_type": "must be a list",
    "finite_number": "must be a finite number",
}

_SIGNS: dict[type, tuple[str, str]] = {  # symbol and attribute of a bound
    Ge: ("≥", "ge"),
    Gt: (">", "gt"),
    Le: ("≤", "le"),
    Lt: ("<", "lt"),
}


def dotted(path: Sequence[str | int]) -> str:
    """Return a key path as in the command line: `a.b.c`."""
    return ".".join(str(p) for p in path)


def explain(
    model: type[BaseModel], places: Mapping[Key, str], name: str, error: ValidationError
) -> list[str]:
    """Return one line per mistake, with its place; `name` replaces an unknown place.

    A value that fits none of several types is one mistake.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for e in error.errors():
        location = _location(places, dict(e))
        texts = found.setdefault((_place(places, location, name), dotted(location)), [])
        text = _text(model, location, dict(e))
        if text not in texts:
            texts.append(text)
    return [
        f"{at}: {key or '(whole file)'}: {', or '.join(texts)}"
        for (at, key), texts in found.items()
    ]


def _location(places: Mapping[Key, str], error: dict[str, Any]) -> Key:
    """Return the key path of the mistake as the file has it.

    Parts that the file does not hold are left out: names of a union's types, keys of a short form.
    """
    whole: Key = tuple(error["loc"])
    if error["type"] in ("missing", "extra_forbidden"):
        return whole
    location: Key = ()
    for part in whole:
        if (*location, part) in places:
            location = (*location, part)
    keys: tuple[str, ...] = getattr(error.get("ctx", {}).get("error"), "keys", ())
    paths = [(*location, *_path(key)) for key in keys]
    return next((p for p in paths if p in places), paths[0] if paths else location)


def _path(key: str) -> Key:
    """Return the key path of a dotted key."""
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


def _place(places: Mapping[Key, str], location: Key, name: str) -> str:
    """Return the place of the key, or of the nearest key above it that a file holds."""
    parents = (location[:n] for n in range(len(location), -1, -1))
    return next((places[p] for p in parents if p in places), name)


def _text(model: type[BaseModel], location: Key, error: dict[str, Any]) -> str:
    kind, got = error["type"], error["input"]
    if kind == "extra_forbidden":
        renamed: Mapping[str, str] = getattr(model, "RENAMED", {})
        if dotted(location) in renamed:
            return f"was renamed to {renamed[dotted(location)]}"
        removed: Mapping[str, str] = getattr(model, "REMOVED", {})
        if dotted(location) in removed:
            return f"was removed: {removed[dotted(location)]}"
        valid = _fields_at(model, location[:-1])
        close = difflib.get_close_matches(str(location[-1]), valid, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        return f"unknown key; {hint}valid: {', '.join(valid)}"
    if kind == "missing":
        return "is missing"
    if kind in ("model_type", "dict_type"):
        return f"must hold `key: value` lines; valid: {', '.join(_fields_at(model, location))}"
    bounds = _bounds(_field_at(model, location))
    text = _WANTED.get(kind, error["msg"].removeprefix("Value error, "))
    if kind == "literal_error":
        text = f"must be {error['ctx']['expected']}"
    elif kind.startswith(("greater_than", "less_than")) and bounds:
        text = f"must be {bounds}"
    elif kind == "too_long" and "actual_length" in error["ctx"]:
        text = f"must have at most {error['ctx']['max_length']} items"
    elif bounds:
        text += f", {bounds}"
    return text if isinstance(got, dict | list) else f"{text}, got {got!r}"


def _field_at(model: type[BaseModel], path: Key) -> FieldInfo | None:
    """Return the field at `path`; None inside lists and for an unknown key."""
    candidates = _models_at(model, path[:-1]) if path else []
    infos = (_fields(c).get(str(path[-1])) for c in candidates)
    return next((i for i in infos if i is not None), None)


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields by their names in a file."""
    return {info.alias or name: info for name, info in model.model_fields.items()}


def _bounds(field: FieldInfo | None) -> str:
    """Return the bounds of a number, e.g. `≥ 1, ≤ 255`; empty without bounds."""
    limits: Iterable[Any] = field.metadata if field is not None else ()
    parts = []
    for limit in limits:
        if type(limit) in _SIGNS:
            sign, attribute = _SIGNS[type(limit)]
            parts.append(f"{sign} {getattr(limit, attribute)}")
    return ", ".join(parts)


def _fields_at(model: type[BaseModel], path: Key) -> list[str]:
    """Return the valid field names below `path`."""
    return sorted({name for c in _models_at(model, path) for name in _fields(c)})


def _models_at(model: type[BaseModel], path: Key) -> list[type[BaseModel]]:
    """Return the settings classes that are valid at `path`."""
    candidates: list[type[BaseModel]] = [model]
    for key in path:
        found: list[type[BaseModel]] = []
        for candidate in candidates:
            info = _fields(candidate).get(str(key))
            found += _models_in(info.annotation) if info else [candidate]
        candidates = found or candidates
    return candidates


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return every settings class inside an annotation (unions, lists, dicts)."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, UnionType, list, tuple, dict) or get_args(annotation):
        return [m for a in get_args(annotation) for m in _models_in(a)]
    return []
