"""Argument types of argparse for whole numbers; a bad number exits with status 2."""

from __future__ import annotations

import argparse


def count(text: str) -> int:
    """Read a whole number that is 1 or more."""
    return _whole(text, 1)


def natural(text: str) -> int:
    """Read a whole number that is 0 or more."""
    return _whole(text, 0)


def _whole(text: str, least: int) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"must be {least} or more, got {text!r}")
    return int(text)
