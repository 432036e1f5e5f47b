"""A campaign's folder: flights of equal settings only, and one campaign at a time."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.recording.folder_lock import FolderInUseError, folder_lock

SETTINGS = "campaign.json"
_MOST_DIFFERENCES = 5  # in the message; a folder of another version may differ in all settings


@contextmanager
def campaign_folder(folder: Path, settings: dict[str, Any]) -> Iterator[None]:
    """Lock the folder of a campaign with these settings; create it, or resume in it.

    Raises:
        SettingsError: the folder cannot be created, holds flights of other settings (the
            message names them), or another campaign is flying into it.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(folder_lock(folder))
        except FolderInUseError:
            raise SettingsError([f"{folder}: another campaign is flying into it"]) from None
        except OSError as error:
            why = f"no folder for a campaign: {error.strerror}"
            raise SettingsError([f"{folder}: {why}"]) from error
        asked = dict(_flat("", settings))
        path = folder / SETTINGS
        if not path.exists():
            unfinished = path.with_suffix(".part")
            unfinished.write_text(json.dumps(asked, indent=1), encoding="utf-8")
            unfinished.rename(path)
        elif other := _differences(_read(path), asked):
            why = f"holds another campaign ({', '.join(other)}); choose another --out"
            raise SettingsError([f"{folder}: {why}"])
        else:  # a campaign wrote this folder, so what is unfinished in it is a campaign's too
            shutil.rmtree(folder / "unfinished", ignore_errors=True)
        yield


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield every value with its dotted path."""
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
    """Return the first settings that differ, each as text."""
    found = [
        f"{k} {before.get(k)!r}, not {asked.get(k)!r}"
        for k in {**before, **asked}
        if before.get(k) != asked.get(k)
    ]
    more = len(found) - _MOST_DIFFERENCES
    return found[:_MOST_DIFFERENCES] + ([f"and {more} more"] if more > 0 else [])
