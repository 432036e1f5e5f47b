"""A campaign's folder: of one kind of flights only, and one campaign's at a time."""

from __future__ import annotations

import fcntl
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mavlink_bridge.shared.settings import SettingsError

REQUEST = "campaign.json"
_LOCK = ".lock"
_TOLD = 5  # differences; a folder of another version may differ in all


@contextmanager
def claimed(folder: Path, settings: dict[str, Any]) -> Iterator[None]:
    """The folder made, seen to hold flights of these very settings, and kept from others.

    Raises:
        SettingsError: it holds flights of others, those that differ are named; or another
            campaign is flying into it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / _LOCK).open("a")
    except OSError as error:
        raise SettingsError([f"{folder}: no folder for a campaign: {error.strerror}"]) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise SettingsError([f"{folder}: another campaign is flying into it"]) from None
        asked = dict(_flat("", settings))
        path = folder / REQUEST
        if not path.exists():
            unfinished = path.with_suffix(".part")
            unfinished.write_text(json.dumps(asked, indent=1), encoding="utf-8")
            unfinished.rename(path)
        elif other := _differences(_read(path), asked):
            why = f"holds another campaign ({', '.join(other)}); choose another --out"
            raise SettingsError([f"{folder}: {why}"])
        else:  # only a campaign's own folder holds what a campaign left unfinished
            shutil.rmtree(folder / "unfinished", ignore_errors=True)
        yield


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Every value by its dotted path."""
    if not isinstance(value, dict) or not value:
        yield path, value
        return
    for key, inner in value.items():
        yield from _flat(f"{path}.{key}" if path else key, inner)


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text("utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise SettingsError([f"{path}: not what a campaign wrote: {error}"]) from error


def _differences(before: dict[str, Any], asked: dict[str, Any]) -> list[str]:
    """The settings that are not the same, in words; the first few."""
    found = [f"{k} {before.get(k)!r}, not {asked.get(k)!r}" for k in {**before, **asked}
             if before.get(k) != asked.get(k)]  # fmt: skip
    more = [f"and {len(found) - _TOLD} more"] if len(found) > _TOLD else []
    return found[:_TOLD] + more
