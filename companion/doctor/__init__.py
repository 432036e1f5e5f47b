"""Preflight check of a board: findings, each with a level and what to do about it."""

from companion.doctor.finding import Finding, Level

__all__ = ["Finding", "Level"]
