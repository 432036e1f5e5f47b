"""The flight application: one drone, one daemon."""
