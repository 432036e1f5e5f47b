"""Real autopilots' SITL binaries on our physics."""
