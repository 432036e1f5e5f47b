"""What all three packages use: frames, settings, thrust, distances, MCAP files."""
