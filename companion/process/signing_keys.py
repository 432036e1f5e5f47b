"""The signing key's file, and the timestamps that must outlive a restart.

A key is 32 bytes, or 64 hexadecimal digits. Without the timestamps, a stream that was recorded
before the restart could be played again.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from mavlink_bridge.wire.signing import KEY_BYTES, LAST, TICKS, Signing, timestamp_at

_SAVE_EVERY = 1.0  # s; messages since the last save could be played again after a crash
_FOR_OTHERS = stat.S_IRWXG | stat.S_IRWXO


class SigningKeyError(OSError):
    """A key that cannot be used; the message names the file and what to do."""


def find_key(name: str, environment: Mapping[str, str]) -> Path:
    """Return the file of a key given by its path, or by the name of a systemd credential."""
    folder = environment.get("CREDENTIALS_DIRECTORY", "")
    credential = Path(folder) / name
    return credential if folder and credential.exists() else Path(name)


def read_key(path: Path, others: int = _FOR_OTHERS) -> bytes:
    """Return the 32 bytes of the key; others: permission bits that must not be set.

    Raises:
        SigningKeyError: the file cannot be read, others can read it too, or it holds no key.
    """
    try:
        mode = path.stat().st_mode
        data = path.read_bytes()
    except OSError as error:
        raise SigningKeyError(f"{path}: cannot be read: {error.strerror}") from error
    if mode & others:
        text = f"{path}: others can read it too (mode {mode & 0o777:o}); chmod 600 {path}"
        raise SigningKeyError(text)
    if len(data) == KEY_BYTES:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise SigningKeyError(
            f"{path}: must hold {KEY_BYTES} bytes or {2 * KEY_BYTES} hexadecimal digits; "
            f"make one: openssl rand -hex {KEY_BYTES}"
        )
    return key


class Timestamps:
    """Keeps the timestamps of signing in a file; a disk error ends that, never the flight."""

    def __init__(self, key: bytes, link_id: int, path: Path | None) -> None:
        """Load the timestamps of `path`; None: they are not kept, a restart trusts the clock."""
        self._path = path
        self._saved = -1e9
        self.signing = Signing(key, timestamp_at(_now()), link_id)
        if path is not None:
            self._load(path)

    def tick(self, monotonic: float) -> None:
        """Advance the time, and save where that is due; monotonic: s, CLOCK_MONOTONIC."""
        self.signing.advance(_now())
        if monotonic - self._saved >= _SAVE_EVERY:
            self._saved = monotonic
            self.save()

    def save(self) -> None:
        """Write the timestamps to the file."""
        if self._path is None:
            return
        state = {
            "timestamp": self.signing.timestamp,
            "streams": [[*stream, newest] for stream, newest in self.signing.streams.items()],
        }
        part = self._path.with_suffix(".part")
        try:
            part.write_text(json.dumps(state))
            part.replace(self._path)
        except OSError:
            self._path = None

    def _load(self, path: Path) -> None:
        """Take the saved timestamps, and never less than them; a damaged file counts as none."""
        try:
            state = json.loads(path.read_text())
            before = int(state["timestamp"])
            streams = {(int(a), int(b), int(c)): int(t) for a, b, c, t in state["streams"]}
        except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return
        if not all(0 <= t < LAST for t in (before, *streams.values())):
            return
        margin = round(_SAVE_EVERY * TICKS)
        self.signing.timestamp = max(self.signing.timestamp, before + margin)
        for stream, newest in streams.items():
            self.signing.note(stream, newest)


def timestamps_path(name: str, environment: Mapping[str, str]) -> Path | None:
    """Return the file in the state directory that systemd made; None without systemd."""
    folder = environment.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(folder) / f"signing-{name}.json" if folder else None


def _now() -> float:
    return datetime.now(UTC).timestamp()


def open_signing(name: str, key: str, link_id: int) -> Timestamps:
    """Return the key and the timestamps with which a daemon signs and checks.

    Raises:
        SigningKeyError: the key cannot be used.
    """
    path = find_key(key, os.environ)
    # systemd gives the service's user access by an ACL, whose mask shows as the group's bits.
    credential = str(path.parent) == os.environ.get("CREDENTIALS_DIRECTORY")
    read = read_key(path, stat.S_IRWXO if credential else _FOR_OTHERS)
    return Timestamps(read, link_id, timestamps_path(name, os.environ))
