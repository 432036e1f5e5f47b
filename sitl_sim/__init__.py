"""The simulated world, and vehicles that speak MAVLink."""
