"""Strict YAML, layered, validated by pydantic; every error is `file:line:column: key: …`.

Ambiguous values of YAML 1.1 are refused: only `true` and `false` are booleans, `012`, `.nan` and
`.inf` are no numbers, and each key is unique.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from mavlink_bridge.shared.explain import Key, dotted, explain

_LARGEST = 256 << 10  # bytes of a file; YAML is read at 100 kB a second

Model = TypeVar("Model", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of all settings: immutable, no unknown keys, no coercion, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Contradiction(ValueError):
    """Values that contradict each other; a model's validator raises it.

    keys: dotted, below the model; the first key that a file holds gives the place.
    """

    def __init__(self, keys: Sequence[str], text: str) -> None:
        super().__init__(text)
        self.keys = tuple(keys)


class SettingsError(ValueError):
    """Mistakes in settings, one line each in `problems`."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)

    def __reduce__(self) -> tuple[type[SettingsError], tuple[list[str]]]:
        """Keep `problems` when the error is pickled."""
        return type(self), (self.problems,)


@dataclass(frozen=True)
class Document:
    """Plain data, the place of each value (`file:line:column` by key path), and problems.

    `validate` reports all problems at once.
    """

    data: dict[str, Any] = field(default_factory=dict)
    places: dict[Key, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader with the strict scalars of this module and without aliases."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse aliases: a few lines of them can fill the memory."""
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases are not used here", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Add the place to the error of a value that does not fit its tag (`!!int x`)."""
        try:
            return super().construct_object(node, deep)
        except ValueError as error:
            text = str(error)
            raise yaml.MarkedYAMLError(problem=text, problem_mark=node.start_mark) from error


_StrictLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"true|false", "tf"),
    ("null", r"~|null|", ["~", "n", ""]),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?",
        "-+.0123456789",
    ),
):
    _StrictLoader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first)
    )


def load_yaml(path: Path) -> Document:
    """Read one file.

    Raises:
        SettingsError: the file is missing, too large, bad YAML, or a list or scalar at the top.
    """
    try:
        if (size := path.stat().st_size) > _LARGEST:
            raise SettingsError([f"{path}: must have at most {_LARGEST} bytes, got {size}"])
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise SettingsError([f"{path}: cannot be read: {reason}"]) from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, name: str) -> Document:
    """Read YAML text as `load_yaml` reads a file; messages call it `name`."""
    try:
        loader = _StrictLoader(text)
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        at = f"{name}:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
        raise SettingsError([f"{at}: not YAML: {error.reason}"]) from error
    try:
        root = loader.get_single_node()
        if root is None:
            return Document()
        if not isinstance(root, yaml.MappingNode):
            raise SettingsError([f"{_at(name, root)}: the file must hold `key: value` lines"])
        places: dict[Key, str] = {}
        problems: list[str] = []
        _walk(root, (), name, places, problems)
        return Document(loader.construct_document(root), places, problems)
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
    """Merge the documents, later ones over earlier ones; lists are replaced whole."""
    merged = Document()
    for document in documents:
        overlay(merged.data, document.data)
        whole = document.places.keys() - {key[:-1] for key in document.places}
        for key in [k for k in merged.places if any(k[:n] in whole for n in range(1, len(k)))]:
            del merged.places[key]  # items of a list that is replaced
        merged.places.update(document.places)
        merged.problems.extend(document.problems)
    return merged


def assignments(items: Iterable[str], name: str = "--set") -> Document:
    """Return `path.to.key=value` arguments as a document; values are YAML."""
    documents = []
    for item in items:
        path, equals, value = item.partition("=")
        if not equals or not all(path.split(".")):
            raise SettingsError([f"{name} {item}: must be path.to.key=value"])
        keys = path.split(".")
        parsed = parse_yaml(f"v: {value}", f"{name} {item}")
        if list(parsed.data) != ["v"]:
            raise SettingsError([f"{name} {item}: must be path.to.key=value"])
        problems = [
            f"{name} {item}: {path}.{p.removeprefix(f'{name} {item}').split(': v.', 1)[1]}"
            for p in parsed.problems
        ]
        data: dict[str, Any] = {keys[-1]: parsed.data["v"]}
        for key in reversed(keys[:-1]):
            data = {key: data}
        places: dict[Key, str] = {tuple(keys[: n + 1]): f"{name} {item}" for n in range(len(keys))}
        documents.append(Document(data, places, problems))
    return merge(documents)


def validate(model: type[Model], document: Document, name: str) -> Model:
    """Return the document as a `model`.

    Raises:
        SettingsError: lists every mistake with its place.
    """
    problems = list(document.problems)
    try:
        valid = model.model_validate(document.data)
    except ValidationError as error:
        problems += explain(model, document.places, name, error)
    if problems:
        raise SettingsError(problems)
    return valid


def _walk(
    node: yaml.Node, path: Key, name: str, places: dict[Key, str], problems: list[str]
) -> None:
    places[path] = _at(name, node)
    if isinstance(node, yaml.MappingNode):
        seen: dict[str, str] = {}
        for key_node, value_node in node.value:
            at = _at(name, key_node)
            if key_node.tag != "tag:yaml.org,2002:str":
                raise SettingsError([f"{at}: a key must be a word"])
            key = str(key_node.value)
            if key in seen:
                problems.append(f"{at}: {dotted((*path, key))}: stands twice, first {seen[key]}")
            seen[key] = at
            _walk(value_node, (*path, key), name, places, problems)
            places[(*path, key)] = at
    elif isinstance(node, yaml.SequenceNode):
        for n, item in enumerate(node.value):
            _walk(item, (*path, n), name, places, problems)


def _at(name: str, node: yaml.Node) -> str:
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def overlay(below: dict[str, Any], above: Mapping[str, Any]) -> None:
    """Merge `above` into `below` in place, nested; mappings are copied, not shared."""
    for key, value in above.items():
        if isinstance(value, Mapping):
            base = below.get(key)
            below[key] = dict(base) if isinstance(base, Mapping) else {}
            overlay(below[key], value)
        else:
            below[key] = value
