"""Bringing drones onto boards: what is shipped, how it gets there, what is done there."""
