"""Figures of a flight: safety, perception, the report."""
