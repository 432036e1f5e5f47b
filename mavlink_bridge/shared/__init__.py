"""Frames, settings, thrust, distances and MCAP files, for all three packages."""
