"""Preflight of a board: what was looked at, how it is, and what to do about it."""

from companion.doctor.finding import Finding, Level

__all__ = ["Finding", "Level"]
