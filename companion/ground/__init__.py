"""Actions on vehicles from a ground station."""
