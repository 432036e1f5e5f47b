"""Actions on many vehicles from a ground station."""
