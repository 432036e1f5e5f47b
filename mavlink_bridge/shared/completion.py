"""Completion of a program's arguments in the shell, by argcomplete."""

from __future__ import annotations

import argparse
import os


def complete(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Answer the shell where it asks for completions, and end; else return the parser."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete  # 30 ms that only the shell's question is worth

        argcomplete.autocomplete(parser)
    return parser
