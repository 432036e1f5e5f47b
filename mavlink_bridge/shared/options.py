"""Whole numbers on a command line: types for argparse, which names the option and exits with 2."""

from __future__ import annotations

import argparse


def count(text: str) -> int:
    """1 or more."""
    return _whole(text, 1)


def natural(text: str) -> int:
    """0 or more."""
    return _whole(text, 0)


def _whole(text: str, least: int) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"must be {least} or more, got {text!r}")
    return int(text)
