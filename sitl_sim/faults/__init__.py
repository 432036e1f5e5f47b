"""Faults of a flight: their catalogue, and how they take effect."""
