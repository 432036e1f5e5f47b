"""SITL binaries of real autopilots on the simulator's physics."""
