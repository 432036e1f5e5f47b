"""The configuration of one drone, and of several that share a board."""
